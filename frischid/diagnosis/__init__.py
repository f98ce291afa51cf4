"""Where a model fails, which physical effect is missing, and how far the error falls with the effect.

Comes in: a model and logs. Goes out: findings with evidence, a verdict, and better models. Start with
`diagnosis`; each stage of `diagnose` is a module, in this order:

1. `motion_cache` (`cached_motion`, `candidate_columns`): logs are read once and kept as filtered torque and columns.
2. `situation`: did the robot change after its model was identified? `change_prior`: the prior of either case.
3. `cross_validation` (`dataset`, `model_columns`, `weighted_fit`): the model's cross-validated error, fold by fold.
4. `contacts` (`robust_fit`, `start_states`, `contacts_that_return`): stretches of time in which something touched the
   robot are left out. `torque_limits`: so are those in which a drive or a sensor is at its limit. `carried_loads`
   (`load_states`): the robot takes a load within a log; the times with the load are left out, or those without.
5. `findings` (`shape_screening`, `scored_candidate`, `symmetric_shifts`, `block_test`, `shape_refinement`,
   `stepwise_selection`, `effect_ranking`): every effect in every place is scored, alone and together. `after_change`:
   of a changed robot also beside the old parameters that hold a part of the effect.
6. `unmodelled_terms` (`gear_steps`, `reversal_residuals`): is the first finding the cause, or does a term outside the
   catalogue explain far more?
7. `verdict`: none, effect, several, contact or unknown; `residual_formula` describes an unknown residual.
8. `hypotheses` and `probability`: how probable is each answer? `rivals`: which other answers share the probability?

The stages share fits (`candidate_fits`, with `sign_bounds`), parts of logs (`stretches`) and the variables of a
residual (`residual_variables`). `effect_findings` makes findings of scored effects. The `result` holds all; `clause`
says it in a clause, `model_notes` what the model had already. `roles` tells which logs may decide and which only test.

`floor` is the noise floor. Held-out errors count without the part that uncertain parameters alone cause, so the floor
has no such part. Noise of drives that is as slow as the motion belongs to it (`slow_noise`, held against the
`residual_spectrum`), and the data may refute it. Repeated motions measure it (`repeats`).
`healthy_twin` is the floor of the error without an effect.

`addition` adds an effect: `shape_choice` gives its shape, `refit` all parameters, a `step` is the outcome.
`improvement` adds findings step by step (`step_acceptance`: may a step stay, by the `rises` of errors at rest?).
`effect_curves` draws them.
`motion_space` adds each finding and simulates the motion.
Every number that decides is a field of `criteria.DiagnosisCriteria`.
"""
