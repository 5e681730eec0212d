"""Many flights, with faults and without, long flights, and reports of any campaign.

many_flights         flights of one airframe file over one site: a row each, and a table
drawn_faults         thousands of flights, each with faults drawn by lot
long_flight          the whole module for hours
safety_timeline      the figure of docs/safety.md
report               flights of any campaign by any of their columns
"""
