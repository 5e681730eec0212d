"""Reading flights back on the ground: our logs and those of others, as one `FlightData`.

open_log             opens any log by what is in it
flight_data          a flight, whoever wrote the log;  parts: put together again
module_log, px4      the module's ULog;  PX4's;  ulog: topics of either
dataflash, tlog      ArduPilot's DataFlash;  the wire as recorded
named_values         what the module tells on the wire, of a tlog;  pitot: a tube's true airspeed
ulog_reader          a ULog's bytes, as far as they can be read;  subscriptions: whose rows
clocks               clocks that jump, stamps that are nonsense
gliding              what a log says of gliding
meanings             what each field means: docs/logs.md
export               CSV, NetCDF, MCAP
"""
