"""NatNet, the protocol that OptiTrack's Motive streams tracked bodies with: bytes and clocks."""
