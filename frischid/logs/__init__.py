"""From files of measurements to logs, and from logs to filtered motions.

Comes in: CSV, Parquet, NPZ or ROS bags. A file is read as a table, a mapping gives the meaning of its columns, a `Log`
holds the samples. Goes out: motions, with positions, velocities and accelerations that no filter has delayed.
Start with `log`, then `readers` and `preprocessing`. The modules by the work that they do:

- **A file as a `table`.** `tables` lists the formats: `csv_files` (with `csv_layout`), `parquet_files` (with
  `list_columns`), `npz_arrays`. `arrow_columns` serves the first two. `bags` reads messages. `content_size` tells how
  much memory a file needs. `table_writing` writes tables.
- **The meaning of its columns.** `mapping` reads a mapping file, whose keys are in `mapping_rules`; `layouts` chooses
  among several. `conversion` makes the channels of a log, and uses `repeated_rows` and `restarts`.
- **A log.** `log` in memory, `recording` chunk by chunk, `log_file` (where it lies). `frames` takes data frames,
  `given` all that a caller may give. `stretch` and `excerpt` are parts.
- **A proposed mapping.** `mapping_guess` makes a `proposal` from a file (`mapping_table`): by names (`column_names`,
  `column_words`), units (`column_units`), motion (`column_motion`), gains (`gain_guess`) and the columns
  that none of these explains (`left_columns`). `mapping_fix` undoes the faults that a check found.
- **Torque that was not measured.** `driven` takes it from commands (`controller`, `controller_values`,
  `delayed_commands`, `command_checks`) or from currents (`current_gains`); `torque_instead` says where
  else it may come from.
- **A motion.** `preprocessing` uses `time_grid`, `derivatives`, `filters` and `standstill`. `summary` looks at all logs
  before: `cutoff_choice`, `velocity_lag`, `wraps`, `poses`, `locked_joints`, `repeated_motion`.
- **Public logs.** `datasets`, `dataset_list`, `dataset_checks`.
"""
