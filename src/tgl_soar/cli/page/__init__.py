"""The operator's page: a ground station of its own, and one page for browsers.

command      `tgl-soar page`
desk         all parts together, and the pages that watch
station      what telemetry reported, and parameters as the module echoes them
orders       what is asked of the module, until it is confirmed or refused
settling_preview    where a line would settle, when, and why it would be refused
scene        the place: ground, air, contour, lines, parameters' meanings
measured_air the air as measured in flight, as a map
browser_requests    who holds the line, and what browsers may ask
broadcast    frames for browsers: what has changed, 20 times a second
server       the page, its files and its socket
recording    a log in the place of a flight
static/      what runs in the browser
"""
