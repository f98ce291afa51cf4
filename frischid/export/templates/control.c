/*
@head@
 */
#include <math.h>

#define FRISCHID_JOINTS @J@
#define FRISCHID_BODIES @L@

typedef struct {
    int parent, leader, slides;
    double factor, shift, R[9], p[3], axis[3], m, h[3], I[9];
} frischid_body;

static const double frischid_gravity[3] = @gravity@;

static const frischid_body frischid_bodies[FRISCHID_BODIES] = {
@tables@
};

static void frischid_cross(const double *a, const double *b, double *out)
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static double frischid_dot(const double *a, const double *b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* out = M x, or M' x */
static void frischid_apply(const double *M, const double *x, int transposed, double *out)
{
    int i;
    for (i = 0; i < 3; i++)
        out[i] = transposed ? M[i] * x[0] + M[3 + i] * x[1] + M[6 + i] * x[2]
                            : M[3 * i] * x[0] + M[3 * i + 1] * x[1] + M[3 * i + 2] * x[2];
}

/* R0 exp(axis angle), by Rodrigues */
static void frischid_turn(const double *R0, const double *s, double angle, double *R)
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

static void frischid_rigid(const double *q, const double *v, const double *a, double *tau)
{
    double R[FRISCHID_BODIES][9], p[FRISCHID_BODIES][3], w[FRISCHID_BODIES][3], dw[FRISCHID_BODIES][3];
    double dv[FRISCHID_BODIES][3], f[FRISCHID_BODIES][3], n[FRISCHID_BODIES][3];
    const double still[3] = {0.0, 0.0, 0.0};
    const double up[3] = {-frischid_gravity[0], -frischid_gravity[1], -frischid_gravity[2]};
    double x[3], y[3], z[3];
    int i, k;

    for (i = 0; i < FRISCHID_BODIES; i++) {
        const frischid_body *b = &frischid_bodies[i];
        const double *wp = b->parent < 0 ? still : w[b->parent], *dwp = b->parent < 0 ? still : dw[b->parent];
        const double *dvp = b->parent < 0 ? up : dv[b->parent];
        const double angle = b->factor * q[b->leader] + b->shift;
        const double rate = b->factor * v[b->leader], second = b->factor * a[b->leader];
        frischid_turn(b->R, b->axis, b->slides ? 0.0 : angle, R[i]);
        frischid_apply(b->R, b->axis, 0, x);
        for (k = 0; k < 3; k++)
            p[i][k] = b->p[k] + (b->slides ? x[k] * angle : 0.0);
        frischid_cross(wp, p[i], x);
        frischid_cross(wp, x, y);
        frischid_cross(dwp, p[i], x);
        for (k = 0; k < 3; k++)
            z[k] = dvp[k] + x[k] + y[k];
        frischid_apply(R[i], z, 1, dv[i]);
        frischid_apply(R[i], wp, 1, w[i]);
        frischid_apply(R[i], dwp, 1, dw[i]);
        for (k = 0; k < 3; k++)
            z[k] = b->axis[k] * rate;
        if (b->slides) {
            frischid_cross(w[i], z, x);
            for (k = 0; k < 3; k++)
                dv[i][k] += b->axis[k] * second + 2.0 * x[k];
        } else {
            for (k = 0; k < 3; k++)
                w[i][k] += z[k];
            frischid_cross(w[i], z, x);
            for (k = 0; k < 3; k++)
                dw[i][k] += b->axis[k] * second + x[k];
        }
        frischid_cross(w[i], b->h, x);
        frischid_cross(w[i], x, y);
        frischid_cross(dw[i], b->h, x);
        for (k = 0; k < 3; k++)
            f[i][k] = b->m * dv[i][k] + x[k] + y[k];
        frischid_apply(b->I, w[i], 0, x);
        frischid_cross(w[i], x, y);
        frischid_apply(b->I, dw[i], 0, x);
        frischid_cross(b->h, dv[i], z);
        for (k = 0; k < 3; k++)
            n[i][k] = x[k] + y[k] + z[k];
    }
    for (i = FRISCHID_BODIES - 1; i >= 0; i--) {
        const frischid_body *b = &frischid_bodies[i];
        tau[b->leader] += b->factor * frischid_dot(b->axis, b->slides ? f[i] : n[i]);
        if (b->parent < 0)
            continue;
        frischid_apply(R[i], f[i], 0, x);
        frischid_apply(R[i], n[i], 0, y);
        frischid_cross(p[i], x, z);
        for (k = 0; k < 3; k++) {
            f[b->parent][k] += x[k];
            n[b->parent][k] += y[k] + z[k];
        }
    }
}

/* Torque of friction alone, with the sign it has in the equation of motion. */
void friction(const double q[FRISCHID_JOINTS], const double v[FRISCHID_JOINTS], double tau[FRISCHID_JOINTS])
{
    int j;
    (void)q, (void)v;
    for (j = 0; j < FRISCHID_JOINTS; j++)
        tau[j] = 0.0;
@friction@
}

/* Torque of a motion: links, rotors, friction and all other effects of the model. */
void inverse_dynamics(const double q[FRISCHID_JOINTS], const double v[FRISCHID_JOINTS],
                      const double a[FRISCHID_JOINTS], double tau[FRISCHID_JOINTS])
{
    int j;
    for (j = 0; j < FRISCHID_JOINTS; j++)
        tau[j] = 0.0;
    frischid_rigid(q, v, a, tau);
@effects@
}
