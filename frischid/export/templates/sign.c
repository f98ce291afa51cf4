static double @robot@_sign(double x)
{
    return (double)((x > 0.0) - (x < 0.0));
}
