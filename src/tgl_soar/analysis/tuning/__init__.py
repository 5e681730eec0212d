"""Gains for an airframe: sought on the linear model, chosen and judged in flight.

tune                 the whole of it;  search: by CMA-ES;  progress_file: where it goes on
demands              what gains must give on the linear model;  aircraft: for which aircraft
flights              the gains in flight;  result: in writing
"""
