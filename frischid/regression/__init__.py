"""Motions become columns, columns become moments, moments say which parameters can be identified.

`regressor` evaluates the columns of the robot and its effects, `moments` sums them, `base_parameters` reduces them.
Start with `frischid.regression.moments`.
"""
