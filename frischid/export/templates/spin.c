/* Torque of a rotor of unit inertia that the link before a joint carries: its balance, and its reaction on that link. */
static void @robot@_spin(int body, double ratio, const double *q, const double *v, const double *a, double *tau)
{
    double R[@ROBOT@_BODIES][9], w[@ROBOT@_BODIES][3], e[@ROBOT@_BODIES][3], n[3], x[3], s[3];
    const double still[3] = {0.0, 0.0, 0.0};
    const @robot@_body *own = &@robot@_bodies[body];
    int i, k;

    for (i = 0; i < body; i++) {
        const @robot@_body *b = &@robot@_bodies[i];
        const double *wp = b->parent < 0 ? still : w[b->parent], *ep = b->parent < 0 ? still : e[b->parent];
        const double turns = b->slides ? 0.0 : b->factor;
        @robot@_turn(b->R, b->axis, turns * q[b->leader] + (b->slides ? 0.0 : b->shift), R[i]);
        @robot@_apply(R[i], wp, 1, w[i]);
        @robot@_apply(R[i], ep, 1, e[i]);
        for (k = 0; k < 3; k++) {
            s[k] = turns * v[b->leader] * b->axis[k];
            w[i][k] += s[k];
        }
        @robot@_cross(w[i], s, x);
        for (k = 0; k < 3; k++)
            e[i][k] += turns * a[b->leader] * b->axis[k] + x[k];
    }
    tau[own->leader] += ratio * ratio * a[own->leader];
    if (own->parent < 0 || own->slides)
        return;
    @robot@_apply(own->R, own->axis, 0, s);
    @robot@_cross(w[own->parent], s, x);
    for (k = 0; k < 3; k++)
        n[k] = ratio * (a[own->leader] * s[k] + v[own->leader] * x[k]);
    tau[own->leader] += ratio * @robot@_dot(s, e[own->parent]);
    for (i = own->parent; i >= 0; i = @robot@_bodies[i].parent) {
        const @robot@_body *b = &@robot@_bodies[i];
        tau[b->leader] += b->slides ? 0.0 : b->factor * @robot@_dot(b->axis, n);
        @robot@_apply(R[i], n, 0, x);
        for (k = 0; k < 3; k++)
            n[k] = x[k];
    }
}
