"""A model for other programs: physical links, URDF, MJCF, code for a control loop; and drive gains.

Comes in: a model. Goes out: files that were compared with the model before they appear.
Start with `export`. The modules by the work that they do:

- **Physical links.** `consistency`.
- **URDF.** `urdf`.
- **MJCF.** `mjcf` writes a new file, `mjcf_edit` changes the numbers of the user's own. `mjcf_gears` adds elastic
  gears. `mjcf_share` says which effects the XML has by itself; `mjcf_effects` writes the others as Python.
- **Code.** `code` writes C and NumPy: `code_columns` has each effect's column as an expression (`formula_code` for
  formulas), `code_body` the lines, `names` safe names. `proofread` checks the text.
- **Tables.** `actuators` writes a table of the drives.
- **What a format leaves out.** `reach` and `notes`.
- **Drive gains** from a known payload. `drive_gains` solves the problem of `drive_gain_problem`.
"""
