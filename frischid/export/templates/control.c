/*
@head@
 */
#include <math.h>

#define @ROBOT@_JOINTS @J@
#define @ROBOT@_BODIES @L@

/* Place of each joint in q, v, a and tau. */
enum {
@joints@
};

typedef struct {
    int parent, leader, slides;
    double factor, shift, R[9], p[3], axis[3];
} @robot@_body;

/* Mass, first moments and inertia about the joint's frame. */
typedef struct {
    double m, h[3], I[9];
} @robot@_link;

/* Acceleration of the base that acts as gravity does. */
static const double @robot@_up[3] = @up@;

static const @robot@_body @robot@_bodies[@ROBOT@_BODIES] = {
@tables@
};

@links@

static void @robot@_cross(const double *a, const double *b, double *out)
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static double @robot@_dot(const double *a, const double *b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* out = M x, or M' x */
static void @robot@_apply(const double *M, const double *x, int transposed, double *out)
{
    int i;
    for (i = 0; i < 3; i++)
        out[i] = transposed ? M[i] * x[0] + M[3 + i] * x[1] + M[6 + i] * x[2]
                            : M[3 * i] * x[0] + M[3 * i + 1] * x[1] + M[3 * i + 2] * x[2];
}

/* R0 exp(axis angle), by Rodrigues */
static void @robot@_turn(const double *R0, const double *s, double angle, double *R)
{
    const double c = cos(angle), n = sin(angle), u = 1.0 - c;
    const double E[9] = {c + u * s[0] * s[0], u * s[0] * s[1] - n * s[2], u * s[0] * s[2] + n * s[1],
                         u * s[0] * s[1] + n * s[2], c + u * s[1] * s[1], u * s[1] * s[2] - n * s[0],
                         u * s[0] * s[2] - n * s[1], u * s[1] * s[2] + n * s[0], c + u * s[2] * s[2]};
    int i, j;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++)
            R[3 * i + j] = R0[3 * i] * E[j] + R0[3 * i + 1] * E[3 + j] + R0[3 * i + 2] * E[6 + j];
}

/* Adds the torque of the links to tau. */
static void @robot@_rigid(const @robot@_link *links, const double *up, const double *q, const double *v,
                  const double *a, double *tau)
{
    double R[@ROBOT@_BODIES][9], p[@ROBOT@_BODIES][3], w[@ROBOT@_BODIES][3], dw[@ROBOT@_BODIES][3];
    double dv[@ROBOT@_BODIES][3], f[@ROBOT@_BODIES][3], n[@ROBOT@_BODIES][3];
    const double still[3] = {0.0, 0.0, 0.0};
    double x[3], y[3], z[3];
    int i, k;

    for (i = 0; i < @ROBOT@_BODIES; i++) {
        const @robot@_body *b = &@robot@_bodies[i];
        const @robot@_link *m = &links[i];
        const double *wp = b->parent < 0 ? still : w[b->parent], *dwp = b->parent < 0 ? still : dw[b->parent];
        const double *dvp = b->parent < 0 ? up : dv[b->parent];
        const double angle = b->factor * q[b->leader] + b->shift;
        const double rate = b->factor * v[b->leader], second = b->factor * a[b->leader];
        @robot@_turn(b->R, b->axis, b->slides ? 0.0 : angle, R[i]);
        @robot@_apply(b->R, b->axis, 0, x);
        for (k = 0; k < 3; k++)
            p[i][k] = b->p[k] + (b->slides ? x[k] * angle : 0.0);
        @robot@_cross(wp, p[i], x);
        @robot@_cross(wp, x, y);
        @robot@_cross(dwp, p[i], x);
        for (k = 0; k < 3; k++)
            z[k] = dvp[k] + x[k] + y[k];
        @robot@_apply(R[i], z, 1, dv[i]);
        @robot@_apply(R[i], wp, 1, w[i]);
        @robot@_apply(R[i], dwp, 1, dw[i]);
        for (k = 0; k < 3; k++)
            z[k] = b->axis[k] * rate;
        if (b->slides) {
            @robot@_cross(w[i], z, x);
            for (k = 0; k < 3; k++)
                dv[i][k] += b->axis[k] * second + 2.0 * x[k];
        } else {
            for (k = 0; k < 3; k++)
                w[i][k] += z[k];
            @robot@_cross(w[i], z, x);
            for (k = 0; k < 3; k++)
                dw[i][k] += b->axis[k] * second + x[k];
        }
        @robot@_cross(w[i], m->h, x);
        @robot@_cross(w[i], x, y);
        @robot@_cross(dw[i], m->h, x);
        for (k = 0; k < 3; k++)
            f[i][k] = m->m * dv[i][k] + x[k] + y[k];
        @robot@_apply(m->I, w[i], 0, x);
        @robot@_cross(w[i], x, y);
        @robot@_apply(m->I, dw[i], 0, x);
        @robot@_cross(m->h, dv[i], z);
        for (k = 0; k < 3; k++)
            n[i][k] = x[k] + y[k] + z[k];
    }
    for (i = @ROBOT@_BODIES - 1; i >= 0; i--) {
        const @robot@_body *b = &@robot@_bodies[i];
        tau[b->leader] += b->factor * @robot@_dot(b->axis, b->slides ? f[i] : n[i]);
        if (b->parent < 0)
            continue;
        @robot@_apply(R[i], f[i], 0, x);
        @robot@_apply(R[i], n[i], 0, y);
        @robot@_cross(p[i], x, z);
        for (k = 0; k < 3; k++) {
            f[b->parent][k] += x[k];
            n[b->parent][k] += y[k] + z[k];
        }
    }
}

@functions@