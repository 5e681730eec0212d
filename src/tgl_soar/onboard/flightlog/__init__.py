"""What a flight leaves behind: the log and its topics.  (Read on the ground: `analysis.logs`.)

topics               every topic and its fields, derived from the named tuples of a tick: a new
                     column is a field of `types.Inputs` or `autopilot.Output`
recorder             what the module reports;  spool: buffers;  disk: the thread that writes
writer               the ULog and the .tlog;  ulog_messages: what in it is no row
files                names and how much is kept;  allowance: how much of the wire
"""
