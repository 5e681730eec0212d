"""The simulator bridge: one process that is the Pixhawk and the world around it.

    ground stations  127.0.0.1:14550 ◄──►  :18570 ┐
                                                  ├ Pixhawk ◄─► servos, aircraft, air, sensors
    companion        127.0.0.1:14540 ◄──►  :14580 ┘

Real time: every step has an absolute deadline, so time does not drift; where the machine falls
more than a few steps behind, that time is given up and counted, and never made up for: the world
stands still for so long while the clocks run on.  A machine that is too slow is reported.  The
bridge asks for the priority that comes after the module's loop.

Lockstep: after every step the companion gets the attitude, even unasked, what else its streams
have due, and a TIMESYNC request.
The bridge waits for the answer before time goes on; all that the companion sent before the
answer acts at this very step.  With `--lockstep-gcs` the ground stations are asked in the same
way every 50 ms.  So nothing depends on the machine's speed: the same seed gives the same
flight, bit for bit.  A participant that falls silent is waited for once, named, and given up;
time then goes on at its natural pace until they send again.

With `--mocap natnet` a stand-in for OptiTrack's Motive (`sim.motive`) streams the aircraft's
place as well.  A step's poses are sent before its MAVLink, and in lockstep the stand-in's clock
is simulated time and the bridge waits at the start until a client knows all that it needs: so a
flight by motion capture repeats bit for bit, too.

The aircraft is held at the start, in the wind, until the first override reaches a surface.
Whenever nobody overrides the surfaces the safety pilot flies (`sim.pilot`).  An aircraft that
hits something lies there for 10 s and is then held at the start again.

    command_line    what can be chosen, as one `BridgeOptions` (options)
    process         the program: `tools/sitl_bridge.py`, `python -m tgl_soar.sim.bridge`
    bridge          lets time go on: by the clock (slowness), or in lockstep (lockstep)
    traffic         datagrams between the ports and what is simulated (simulated)
    mocap           the stand-in for Motive, as the bridge sets it up
"""
