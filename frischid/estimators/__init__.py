"""From moments to parameters with bounds.

Comes in: moments of [Y τ], and for some estimators each sensor's noise. Goes out: values, covariances, boxes.
Most modules do not depend on robots. Start with `frischid.estimators.least_squares`.
"""
