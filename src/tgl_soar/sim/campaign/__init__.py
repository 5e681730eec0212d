"""Many flights: one runner for one process, for all processors of a machine, and for several.

flight_list          what a campaign is: a list of flights, each by a function and its job
run                  flies what is missing;  executors: on this machine;  cluster: on several
first_flight         of processes that begin at once one compiles
folder               begins a campaign, or resumes or restarts it
journal              flights on disk as they are flown;  encoding: their bytes;  interrupts: when
                     Ctrl-C acts
rows                 the table;  manifest, provenance: where it comes from
"""
