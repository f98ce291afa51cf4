"""From motions to columns, from columns to moments, and from moments to the parameters that can be identified.

Comes in: a robot, its effects and filtered motions. Goes out: moments of [Y τ] over the base parameters.
Start with `frischid.regression.moments`; `regressor` fills blocks of columns, `accumulation` sums them stretch by
stretch (`moment_blocks`), and `base_parameters` finds the parameters that can be identified. `two_states`: columns that
act for a while only.
"""
