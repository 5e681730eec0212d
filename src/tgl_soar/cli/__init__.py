"""The command line: `tgl-soar COMMAND`, one file a command.

  __main__, app        where it begins;  all commands at once;  `run` goes on in `onboard/process`
  commands             every command and the file that it is in: one is loaded when asked for
  console              where commands print, and how they fail
  conversation         talking to an autopilot on the ground: options of preflight, surfaces, align
  log_argument         the LOG of a command: a file or a folder, and the files that it holds
  batch_options        options of what flies many flights: campaign, experiment, rare

Commands of more than one file, and what goes with one
  page/                `tgl-soar page`
  params               params_page: docs/parameters.md
  compile              direct_tuples: named tuples in the copy that is compiled
  init                 service_unit: the systemd unit
  sitl                 sitl_lines: whether the module takes its lines;  sitl_table: what it shows
  site                 site_init: `tgl-soar site init`;  contour_file: a site file's [contour]
  log                  log_layouts: PlotJuggler's and Foxglove's
  campaign             flights, rare: `tgl-soar campaign flights`, `campaign rare`
  mavproxy_tgl         no command of ours: `tgl` at MAVProxy's prompt
"""
