"""The command line: `tgl-soar COMMAND`, one file a command."""
