"""The flying process: the module and its loop, its watchdog, its log.

The module
  module               init, event, periodic, settings: begin here
  setup, settings      what it is set up from;  the parameters in force, and what follows from them
  clocking             the time of a tick: real time, or lockstep with the simulator
  links, outbox        its links;  frames and texts that go out
  surface_control      surface commands, their release, and the mode that obeys them
  external_positions   positions from elsewhere than the autopilot;  mocap: OptiTrack's sockets
  operators            what operators ask for, and who may
  engage_switch        OP_ENGAGE, OP_FORCE and the pilot's switch: what engages and disengages
  switches             the others, which act from tick to tick and go back by themselves:
                       excitation_switch, search_switch, survey_switch, launch_landing_switch
  search_process       the search for lift in a process of its own
  line_moves           a line that the module moves itself
  firmware_landing     the firmware's own landing, asked for
  gnss_watch           whether the receiver is accurate enough to engage with
  heading_watch        whether the nose points where the aircraft goes through the air
  station_watch        what the silence of every ground station means
  telemetry_values     the numbers of the telemetry;  reports: what is sent unasked
  counters             what the module counts of its own work
  warm_up              a tick computed in advance and thrown away, to fill the caches

The process
  process              what surrounds the module: links, stored parameters, log, signals
  command_line         the options of `tgl-soar run`
  loop, pacing         wait, take in, tick;  when the next tick is due
  realtime             priority, locked memory, clock
  watchdog             the parent process;  watchdog_release: it releases a dead child's surfaces
  flightlog/           the flight log, from its topics to the disk
  link_load            whether a serial line carries the flight
  native               native code, made by `tgl-soar compile`
  console, standard_streams    words for the console
"""
