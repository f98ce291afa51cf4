/* Torques of the past, one row after the other; the oldest row is overwritten first. */
typedef struct {
    int count, newest;
    double t[@stored@], tau[@stored@][@ROBOT@_JOINTS];
} @robot@_delay;

/* The torque `by` seconds ago, on the line between the samples around that time. */
static void @robot@_delayed(@robot@_delay *s, double t, double by, const double *tau, double *out)
{
    int j, late, early;
    if (s->count == 0 || t - s->t[s->newest] >= by / (@stored@ - 2) * 0.999999) {
        s->newest = s->count == 0 ? 0 : (s->newest + 1) % @stored@;
        s->count = s->count < @stored@ ? s->count + 1 : @stored@;
        s->t[s->newest] = t;
        for (j = 0; j < @ROBOT@_JOINTS; j++)
            s->tau[s->newest][j] = tau[j];
    }
    late = early = s->newest;
    for (j = 1; j < s->count && s->t[early] > t - by; j++) {
        late = early;
        early = (early + @stored@ - 1) % @stored@;
    }
    for (j = 0; j < @ROBOT@_JOINTS; j++) {
        const double span = s->t[late] - s->t[early];
        const double share = span > 0.0 ? fmax((t - by - s->t[early]) / span, 0.0) : 0.0;
        out[j] = s->tau[early][j] + share * (s->tau[late][j] - s->tau[early][j]);
    }
}
