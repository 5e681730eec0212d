"""A logged flight through the same laws again: from our own log, or from the wire."""
