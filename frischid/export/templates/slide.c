/* Dahl's friction: the state z of surfaces that bend before they slide. */
typedef struct {
    int slid;
    double z;
} @robot@_slide;

static double @robot@_slid(@robot@_slide *s, double before, double v, double h, double distance)
{
    const double path = 0.5 * (before + v) * h;
    const double side = path > 0.0 ? 1.0 : path < 0.0 ? -1.0 : 0.0;
    if (s->slid) {
        s->z = side - (side - s->z) * exp(-fabs(path) / distance);
    } else if (fabs(v) > @width@) { /* the first clear motion: the joint came a long way in this direction */
        s->slid = 1;
        s->z = v > 0.0 ? 1.0 : -1.0;
    }
    return s->z;
}
