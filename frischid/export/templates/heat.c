/* Heat of a joint's own motion, which flows off with a time constant. */
static double @robot@_heated(double *heat, double before, double v, double h, double constant, double exponent)
{
    const double power = 0.5 * (pow(fabs(before), exponent) + pow(fabs(v), exponent));
    *heat += -expm1(-h / constant) * (power - *heat);
    return *heat;
}

