"""Over the hill: launches and landings, satellites, a rangefinder, an hour of turning wind.

outdoors             launches and landings;  shipped_hill: where they are flown
satellites           a receiver that drifts and falls silent;  rangefinder: one beside it
hour                 an hour of turning wind;  hour_bound: what could be soared of it
hour_walk            the same hour by AOSoar's walk
beating              along the ridge, in a wind too slow to stand in
"""
