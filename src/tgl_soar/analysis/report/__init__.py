"""Figures and pages from flights and simulations.

A figure is in the file that its name says: `field_figure`, `polar_figure`, …  Beside them:
  flight_page          the page of a flight;  page_style: how it looks
  flight_report_figures    its figures
  legs, streams        tables of the page: how the line was held;  how regularly streams came
  spectra              power spectra of what was logged;  spectra_figure
  figure_style         how every figure looks;  smooth_map: maps without a grid's edge
"""
