"""The search for lift, flown: random fields, the module's own closed loop, baselines.

episode              one search;  steered_flight: the closed loop that it is flown in
places               random tunnels and hills;  scoring: what an episode was worth
searchers            who moves the line: the map, the oracle, the baselines
compiled_rollouts    plans by the thousand;  map_from_log: the map of a flight, made again
figures              a search with its map, and the searches that failed
"""
