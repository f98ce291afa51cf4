"""From logs to a model, and from a model to its error on logs.

Comes in: a robot and logs. Goes out: a `Model` that is saved as one JSON file, and its error on other logs.
Start with `identification`. The modules by the work that they do:

- **Identification**, in six stages. `identification_stages` has the first four, `identification_bounds` the fifth,
  `identification` the last. Options: `identify_options`; numbers that decide: `identification_criteria`. Logs are
  checked first (`log_examination`, `log_faults`) and become `log_data`. A fitted model passes once more over its logs
  (`identification_pass`) for its errors (`residual_scores`) and the lag of the torque (`torque_lag`, `lag_sums`).
- **What the user could not name** is fitted too: gains and delay of a controller (`unknown_drive`, `found_gains`),
  its damping (`unknown_damping`, `damping_noise`), torque per ampere (`unknown_gains`, `amperes`). A doubt about a
  delay is a column of its own (`doubtful_delay`, `friction_lead`).
- **The model.** `model`, its `parameters`, the record of its fit (`fit_record`) and of its steps (`events`). As a file:
  `model_file`, `model_records` (fields and types), `model_parts`, `model_digest`, `stored_paths`. `own_logs` finds the
  logs of its fit again. `remembered_blocks` saves time, `model_argument` refuses what is no model, `log_requirements`
  the logs that it cannot use.
- **Errors.** `comparison` is the error on other logs, joint by joint (`joint_fit`), `headline` the one error that is
  printed, with its `grade`. References: `noise_floor` (with `noisy_motion`), `expected_error`, `speed_range`. Numbers
  that decide: `comparison_criteria`. Where a model fails: `residual_conditions`; along a log: `prediction`. The logs
  themselves: `log_quality`, `standstill_joints`.
- **Alarms.** `alarms` has the class, the numbers that decide, and the alarms of the logs. `identification_alarms`
  and `comparison_alarms` collect them, with those of `physical_alarms` (uses `joint_inertia`) and `log_agreement`.
- **A payload.** `payload_identification` fits a body (`payload_fit`), judges it (`payload_alarms`, `payload_carriers`)
  and returns an `identified_payload`.
- **Drives.** `drive_parameters` has gains, delay and friction with ranges; `drive_excitation` plans a motion for them.
"""
