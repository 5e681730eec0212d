"""The control laws: pure functions of parameters, state and measurements.

Laws
  laws                 all their parameters in SI units, from the operator's
  target_line          the line and e_rho;  soaring: e_rho to pitch;  attitude: pitch to elevator,
                       roll to aileron;  heading: to rudder;  pid: what all of them use
  surface_loops        from setpoints to deflections, in this order
  pitch_schedule       gains by speed, lean, latency;  lateral_schedule: of roll and heading
  gain_blend           gains with accelerations, blended with those without
  envelope             the last limiter;  limits of stall, sink and height;  the fence

Deciding
  supervisor           modes and reasons, one table;  supervisor_texts: their words;  conditions:
                       what holds, as bits
  estimates            what a tick knows;  envelope_margins: how far to stall, ground and fence
  forecast             where the aircraft will stop

Other ways to fly
  launch_landing       launch, way home and landing in a tick: launch, landing, weaving,
                       airspeed_hold, airspeed_error, wind_triangle;  glide_home: the height and
                       time left for it;  ridge_beat: to and fro along the ridge
  point                the point on the line in a tick: point_hold, brake_watch, brake_shake
  power                a propeller in a tick: throttle
  search/, survey      looking for lift;  drawing the contour
  excitation           a multisine that shows the margins

Whether a line can be flown
  line_bounds          fence, ground, contour;  line_room: how far down and up a line there is room
  loop_margin          the loop's disk margin;  lateral_margin: of roll and heading

Gains for an aircraft
  found_gains          which they are, and on which aircraft they were found
  pitch_design         sought for the one that is loaded, on the rule's model of its loop
"""
