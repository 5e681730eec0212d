"""Wind fields, turbulence, and the zero excess updraft contour in them.

What every field is
  field                the interface: wind (u, v, w) at a place and a time
  zeuc                 the contour where updraft equals sink; where a line crosses it

Kinds of field
  hill                 flow over a half cylinder;  panels: over any ground profile
  polynomial           wind as a polynomial of position, fitted to any other field
  jet                  a board in an open wind-tunnel jet, made of freestream (the flow in two
                       dimensions) and relief (its finite width);  kept_jets: such air on disk
  grid                 wind on a grid;  grid_files reads it: CSV, `.npz`, NetCDF, VTK, OpenFOAM;
                       grid_checks: is it air?

What changes with time
  gusts                rising and falling winds, discrete gusts, turbulence (Dryden's spectrum)
  wind_record          a mast's record, and the air that it makes
"""
