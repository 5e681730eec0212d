"""What is done with flights afterwards: logs, replay, reports, experiments, fits."""
