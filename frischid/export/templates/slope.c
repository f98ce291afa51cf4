/* out = a x b, and its derivative */
static void @robot@_cross2(const double *a, const double *da, const double *b, const double *db, double *out,
                   double *dout)
{
    double x[3], y[3];
    int k;
    @robot@_cross(da, b, x);
    @robot@_cross(a, db, y);
    for (k = 0; k < 3; k++)
        dout[k] = x[k] + y[k];
    @robot@_cross(a, b, out);
}

/* out = M x or M' x, and its derivative */
static void @robot@_apply2(const double *M, const double *dM, const double *x, const double *dx, int transposed,
                   double *out, double *dout)
{
    double y[3], z[3];
    int k;
    @robot@_apply(dM, x, transposed, y);
    @robot@_apply(M, dx, transposed, z);
    for (k = 0; k < 3; k++)
        dout[k] = y[k] + z[k];
    @robot@_apply(M, x, transposed, out);
}

/* Derivative of the links' torque when one joint's position, speed and acceleration change by dq, dv and da. Names that
 * begin with d and end with _ are the derivatives of the names without. */
static void @robot@_derivative(const @robot@_link *links, const double *q, const double *v, const double *a, int joint,
                       double dq, double dv, double da, double *out)
{
    double R[@ROBOT@_BODIES][9], dR_[@ROBOT@_BODIES][9], p[@ROBOT@_BODIES][3], dp_[@ROBOT@_BODIES][3];
    double w[@ROBOT@_BODIES][3], dw_[@ROBOT@_BODIES][3], e[@ROBOT@_BODIES][3], de_[@ROBOT@_BODIES][3];
    double c[@ROBOT@_BODIES][3], dc_[@ROBOT@_BODIES][3], f[@ROBOT@_BODIES][3], df_[@ROBOT@_BODIES][3];
    double n[@ROBOT@_BODIES][3], dn_[@ROBOT@_BODIES][3];
    const double still[3] = {0.0, 0.0, 0.0};
    double x[3], y[3], z[3], dx_[3], dy_[3], dz_[3];
    int i, k;

    for (k = 0; k < @ROBOT@_JOINTS; k++)
        out[k] = 0.0;
    for (i = 0; i < @ROBOT@_BODIES; i++) {
        const @robot@_body *b = &@robot@_bodies[i];
        const @robot@_link *m = &links[i];
        const int base = b->parent < 0, own = b->leader == joint, u = base ? 0 : b->parent;
        const double *wp = base ? still : w[u], *dwp_ = base ? still : dw_[u];
        const double *ep = base ? still : e[u], *dep_ = base ? still : de_[u];
        const double *cp = base ? @robot@_up : c[u], *dcp_ = base ? still : dc_[u];
        const double angle = b->factor * q[b->leader] + b->shift, dangle_ = own ? b->factor * dq : 0.0;
        const double rate = b->factor * v[b->leader], drate_ = own ? b->factor * dv : 0.0;
        const double second = b->factor * a[b->leader], dsecond_ = own ? b->factor * da : 0.0;
        @robot@_turn(b->R, b->axis, b->slides ? 0.0 : angle, R[i]);
        for (k = 0; k < 9; k++)
            dR_[i][k] = 0.0;
        for (k = 0; k < 3 && !b->slides; k++) {
            @robot@_cross(&R[i][3 * k], b->axis, x);
            dR_[i][3 * k] = dangle_ * x[0];
            dR_[i][3 * k + 1] = dangle_ * x[1];
            dR_[i][3 * k + 2] = dangle_ * x[2];
        }
        @robot@_apply(b->R, b->axis, 0, x);
        for (k = 0; k < 3; k++) {
            p[i][k] = b->p[k] + (b->slides ? x[k] * angle : 0.0);
            dp_[i][k] = b->slides ? x[k] * dangle_ : 0.0;
        }
        @robot@_cross2(wp, dwp_, p[i], dp_[i], x, dx_);
        @robot@_cross2(wp, dwp_, x, dx_, y, dy_);
        @robot@_cross2(ep, dep_, p[i], dp_[i], x, dx_);
        for (k = 0; k < 3; k++) {
            z[k] = cp[k] + x[k] + y[k];
            dz_[k] = dcp_[k] + dx_[k] + dy_[k];
        }
        @robot@_apply2(R[i], dR_[i], z, dz_, 1, c[i], dc_[i]);
        @robot@_apply2(R[i], dR_[i], wp, dwp_, 1, w[i], dw_[i]);
        @robot@_apply2(R[i], dR_[i], ep, dep_, 1, e[i], de_[i]);
        for (k = 0; k < 3; k++) {
            z[k] = b->axis[k] * rate;
            dz_[k] = b->axis[k] * drate_;
        }
        if (b->slides) {
            @robot@_cross2(w[i], dw_[i], z, dz_, x, dx_);
            for (k = 0; k < 3; k++) {
                c[i][k] += b->axis[k] * second + 2.0 * x[k];
                dc_[i][k] += b->axis[k] * dsecond_ + 2.0 * dx_[k];
            }
        } else {
            for (k = 0; k < 3; k++) {
                w[i][k] += z[k];
                dw_[i][k] += dz_[k];
            }
            @robot@_cross2(w[i], dw_[i], z, dz_, x, dx_);
            for (k = 0; k < 3; k++) {
                e[i][k] += b->axis[k] * second + x[k];
                de_[i][k] += b->axis[k] * dsecond_ + dx_[k];
            }
        }
        @robot@_cross2(w[i], dw_[i], m->h, still, x, dx_);
        @robot@_cross2(w[i], dw_[i], x, dx_, y, dy_);
        @robot@_cross2(e[i], de_[i], m->h, still, x, dx_);
        for (k = 0; k < 3; k++) {
            f[i][k] = m->m * c[i][k] + x[k] + y[k];
            df_[i][k] = m->m * dc_[i][k] + dx_[k] + dy_[k];
        }
        @robot@_apply(m->I, w[i], 0, x);
        @robot@_apply(m->I, dw_[i], 0, dx_);
        @robot@_cross2(w[i], dw_[i], x, dx_, y, dy_);
        @robot@_apply(m->I, e[i], 0, x);
        @robot@_apply(m->I, de_[i], 0, dx_);
        @robot@_cross2(m->h, still, c[i], dc_[i], z, dz_);
        for (k = 0; k < 3; k++) {
            n[i][k] = x[k] + y[k] + z[k];
            dn_[i][k] = dx_[k] + dy_[k] + dz_[k];
        }
    }
    for (i = @ROBOT@_BODIES - 1; i >= 0; i--) {
        const @robot@_body *b = &@robot@_bodies[i];
        out[b->leader] += b->factor * @robot@_dot(b->axis, b->slides ? df_[i] : dn_[i]);
        if (b->parent < 0)
            continue;
        @robot@_apply2(R[i], dR_[i], f[i], df_[i], 0, x, dx_);
        @robot@_apply2(R[i], dR_[i], n[i], dn_[i], 0, y, dy_);
        @robot@_cross2(p[i], dp_[i], x, dx_, z, dz_);
        for (k = 0; k < 3; k++) {
            f[b->parent][k] += x[k];
            df_[b->parent][k] += dx_[k];
            n[b->parent][k] += y[k] + z[k];
            dn_[b->parent][k] += dy_[k] + dz_[k];
        }
    }
}
