"""Aircraft unlike the one that the gains were found on, and what a glide's log says of one."""
