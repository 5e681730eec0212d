"""Finding lift and keeping it: the map, the search, the survey, the forecast of no place."""
