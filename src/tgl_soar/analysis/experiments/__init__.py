"""Experiments flown in simulation: the paper's claims, and aims of our own.

  catalogue            every experiment by its name
  context, result      what an experiment is given;  what it says: claims, tables, figures
  scenario, flights    scenario files;  their flights, many at a time
  random_aircraft      an aircraft unlike its file in air unlike its site's;  random_jet: a jet's
  spread_along_line    how far turbulence moves an aircraft along its line, by theory
  pages, staleness     docs/experiments.md and docs/aims.md;  whether they are of today's laws
  staleness_probes     whether sections of other pages are

The first line of each file has the names by which `tgl-soar experiment` flies it:
  paper/               the paper's own
  loop/                what the loops bear: leans, latency, margins
  aircraft/            other aircraft than that of the file;  a model from a glide's log
  estimates/           what is known in flight: motion, wind, angle of attack
  lift/                finding lift: map, search, survey, lines without a place to settle
  point/               a point held with a brake
  outdoors/            launches, landings, satellites, a rangefinder, an hour of turning wind
"""
