"""The paper's experiments: on a line, in changing air, at other leans and speeds.

still_lines          `static`, `translate`, `back`, `rotate`;  line_lean: `lean`
changing_air         `slope`, `wind`;  air_speed: `speed`;  gust_response: `gust`
field, places        `field`;  `places`
"""
