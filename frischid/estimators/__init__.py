"""Moments become parameters with bounds.

Comes in: moments of [Y τ], and for some estimators each sensor's noise. Goes out: values, covariances, boxes.
Most modules know numbers only, no robot. Start with `frischid.estimators.least_squares`.
"""
