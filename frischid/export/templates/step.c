/* What the torque depends on besides q, v and a. */
typedef struct {
    int started;
    double t;                      /* time since the first step, s */
    double v[@ROBOT@_JOINTS];        /* speeds at the last step */
    double friction[@ROBOT@_JOINTS]; /* part of the last torque that is friction */
@fields@
} @robot@_state;

/* Makes a state new: nothing has happened yet. */
void @robot@_init(@robot@_state *state)
{
    static const @robot@_state fresh;
    int j = 0;
    (void)j;
    *state = fresh;
@warm@
}

/* Torque of the next sample of a motion: links, rotors, friction and all other effects of the model. dt is the time
 * since the last call, s; the first call takes no time. */
void @robot@_step(@robot@_state *state, const double q[@ROBOT@_JOINTS], const double v[@ROBOT@_JOINTS],
          const double a[@ROBOT@_JOINTS], double dt, double tau[@ROBOT@_JOINTS])
{
    const double h = state->started && dt > 0.0 ? dt : 0.0;
    double *friction = state->friction;
    int j;
    state->t += h;
    for (j = 0; j < @ROBOT@_JOINTS; j++)
        tau[j] = friction[j] = 0.0;
    @robot@_rigid(@robot@_links, @robot@_up, q, v, a, tau);
@effects@
    for (j = 0; j < @ROBOT@_JOINTS; j++)
        state->v[j] = v[j];
    state->started = 1;
}
