"""What the loops bear: margins by the linear model, every lean, links that are late."""
