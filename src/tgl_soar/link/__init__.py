"""Talking to autopilots, ground stations and motion capture.

Bytes and messages
  open_link            a link by its name;  transports/: UDP, TCP, serial lines
  frames, decoder      bytes to messages;  inbound_messages: those that pymavlink parses
  encoder              messages to bytes;  outbound_messages: those that pymavlink packs
  messages             every MAVLink message that is used, as a named tuple: a new one begins here
  hot_frames           the messages of every tick, and those that pymavlink does not know, read and
                       written at fixed offsets
  signing              MAVLink 2 signing;  signing_keys: the key file and its timestamp
  routing              several links: who is on which, and what is lost

The autopilot
  session              the conversation: what it sends is handed to what uses it
  autopilots/          one file for each firmware: routes, modes, time-outs, requirements
  vehicle/             its status and samples, and the rates at which they are requested
  stream_requests      requesting messages at a rate, until they come
  sensor_units         sensor messages in SI units;  sensor_clock: when a sample was taken
  clock, timesync      its clock against ours;  the round trip, and queues on the link
  mode_change          into the mode of a route and back;  mission: its own landing
  autopilot_setup_check    its set-up, read before an engagement
  checks/              `tgl-soar preflight` and `tgl-soar surfaces`

Position
  sources              which source of position is used
  natnet/, optitrack   the protocol of Motive;  position fixes from it
  pose_forwarding      the tracked pose, sent to the autopilot
  tracked_attitude     a tracker's attitude in place of the autopilot's
  tangent_plane        latitude and longitude to local NED

Ground stations
  commands             engage, release, abort; what else may be asked by command
  engagement           an abort, and the pilot's switch
  parameter_server     the MAVLink parameter server
  telemetry            texts and numbers within a budget of bytes
  presence             our heartbeat, and duplicates of this module
  component_metadata   what parameters mean, as files;  file_transfer: sends these and no others
"""
