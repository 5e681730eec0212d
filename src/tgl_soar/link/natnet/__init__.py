"""NatNet, the protocol that OptiTrack's Motive streams tracked bodies with: bytes and clocks.

layout               the bytes of each version of the protocol
server               who the server is, and its bodies' names;  sockets: datagrams
pose_filter          position fixes from poses;  track: whether one can follow the last
clock, frame_times   the server's clock against ours;  when a pose was true
settings             the site's [mocap];  listing: which bodies a server streams
diagnostics          counters and notices
"""
