"""What is done with flights afterwards: logs, replay, reports, experiments, fits.

Logs and what is drawn of them
  logs/                reading flights back, ours and others', as one `FlightData`
  replay/              a logged flight through the same laws again
  report/              figures and pages;  loop_response: the margins that a multisine shows

From logs to an aircraft and a place
  manoeuvres           where a log tells something of the aircraft
  identification       short period and elevator from doublets;  drag: from steady glides;
                       identified_file: the airframe file that they make
  alignment            the axes of a motion-capture hall in local NED
  terrain/             from an elevation model to a first site file
  tuning/              gains for an airframe

The linear model
  linear_plant         the aircraft;  linear_controller: estimator and laws;  linear_model: the loop
  lateral_model        the same of roll and heading;  brake_loop: of a point that the brake holds
  margins              what the loops bear, over speed, lean and latency

Flights flown to learn from them
  experiments/         the paper's, and our own aims
  campaigns/           thousands of flights with faults, and long ones;  rare/: losses that plain
                       flights never show
  search/, survey/     episodes of the search for lift;  surveys of a contour
  flown_airframe       the aircraft that is flown, where it is not that of its file
"""
