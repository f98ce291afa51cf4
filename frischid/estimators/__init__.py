"""From moments to parameters with bounds.

Comes in: moments of [Y τ], and for some estimators each sensor's noise. Goes out: values, covariances, boxes.
Most modules do not depend on robots. Start with `least_squares`. The modules by the work that they do:

- **Values from moments.** `least_squares` solves the `normal_equations`. `map_estimate` adds a prior (`map_problem`):
  `urdf_prior` makes it, `parameter_prior` is its form. `physical_links` finds links that could exist, near
  `nominal_links`. `drive_gain_ls` and `torque_scale` leave the scale of each torque open.
- **Values where the regressor is noisy.** `sensor_noise` has the effect of each sensor's noise.
  `errors_in_variables` and `instrumental_variables` account for the noise. `state_samples` has the states.
- **Boxes.** `frisch` and `sensorwise` bound the parameters; `bbrf` intersects the boxes of windows (`bbrf_windows`).
  `frisch_selection` and `box_qp` choose a point of a box.
- **How far to trust a value.** `autocorrelation` counts independent samples, `moderation` steadies standard errors,
  `precision` inverts covariances. `held_out` cross-validates, `p_values` has the tests.
- **Shape of friction.** `friction_smoothing` chooses the width of the change of sign.
"""
