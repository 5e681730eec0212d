"""The simulated world: aircraft, sensors, servos, a Pixhawk that speaks MAVLink.

The world and what is in it
  world                air, aircraft, servos, sensors as one object;  world_step: one step of it
  aircraft, point_mass two aircraft;  flown_aircraft: what any must have;  propeller, tether, throw
  servos, white_noise  surfaces' servos;  all that is random;  box_muller: Gaussian numbers
  flight_turbulence    the turbulence of one flight
  sensors              rates, delays, noise of each;  sensor_sampling: what they measure in a flight
  faults, injection    every fault, declared;  faults at work
  truth_log            what really happened

Flights in one process
  flight               one flight, a pure function;  closed_loop: the same on a `World`
  compiled_flight      compiled;  watched_flight: looked at now and then;  commanded_flight: gym's
  campaign/            many flights on many processors;  score: what a flight was worth
  glide_test           a gliding test flight

Compiling them (numba)
  compiled             the kernels, of which modules;  kernel_cache: on disk
  compiled_air         the air as data;  lines_ahead: rollouts
  cells                for numba alone, as inlined_functions

Flights between processes
  simulation           world, Pixhawk, pilot and faults together, without sockets
  vehicle/             the simulated Pixhawk;  channels, sensor_messages: its inputs and reports
  firmware/            real firmwares in its place;  child_process: their programs
  bridge/              the process;  ports, routing: its sockets and the way between links
  motive               a stand-in for OptiTrack's Motive;  natnet_frames: its bytes
  pilot, operator      people;  hostile: frames that nobody should send
  sitl                 `tgl-soar sitl`: sitl_options, sitl_processes, sitl_landing, sitl_notes,
                       sitl_page
"""
