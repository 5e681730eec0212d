"""From a digital elevation model to a first site file: ground, flow over it, fence, lines."""
