/* A spring or a gap between a motor and its link. unit: torque of a spring, or shares of the gap, per deflection. */
typedef struct {
    int joint, rigid;
    double stiffness, damping, gap, dry, unit, least;
} @robot@_gear;

static const @robot@_gear @robot@_gears[] = {
@gears@
};

/* Where a link is behind its motor (place, its rate), and what drove it at the last step: speed of the motor, sign of
 * that speed, load, inertia of the link, derivatives of the load by speed and position. */
typedef struct {
    int steps;
    double place, rate, speed, pushed, h, road[6];
} @robot@_lag;

/* Moves a link by one step of the midpoint rule, and gives the change of all torques per unit of the gear's parameter. */
static void @robot@_lagged(const @robot@_gear *g, @robot@_lag *s, const double *q, const double *v, const double *a,
                   const double *load, double h, double *out)
{
    const int i = g->joint;
    const double gap = g->gap > 0.0 ? g->gap : HUGE_VAL;
    double now[6] = {v[i], tanh(v[i] / @width@), load[i], 0.0, 0.0, 0.0}, slope[@ROBOT@_JOINTS];
    double speed = s->speed, second = 0.0;
    int j;
    @robot@_derivative(@robot@_load_links, q, v, a, i, 0.0, 0.0, 1.0, slope);
    now[3] = fmax(slope[i], g->least);
    @robot@_derivative(@robot@_load_links, q, v, a, i, 0.0, 1.0, 0.0, slope);
    now[4] = slope[i];
    @robot@_derivative(@robot@_load_links, q, v, a, i, 1.0, 0.0, 0.0, slope);
    now[5] = slope[i];
    if (g->rigid || s->steps == 0) {
        const double carried = load[i] + g->dry * now[1];
        const double place = g->gap > 0.0 ? copysign(g->gap, carried) : g->rigid ? carried : carried / g->stiffness;
        if (s->steps > 0 && h > 0.0)
            speed = (place - s->place) / h;
        s->place = place;
    } else if (h > 0.0) {
        const double motor = 0.5 * (s->road[0] + now[0]), sign = 0.5 * (s->road[1] + now[1]);
        const double pulled = 0.5 * (s->road[2] + now[2]), inert = 2.0 / h * (0.5 * (s->road[3] + now[3]));
        const double drag = 0.5 * (s->road[4] + now[4]), spring = g->stiffness + 0.5 * (s->road[5] + now[5]);
        const double held = inert + fmax(drag + g->damping, 0.0) + 0.5 * h * spring;
        const double push = held * motor - pulled - inert * s->rate + spring * s->place;
        const double rubbing = fmax(fmin(push, g->dry), -g->dry);
        const double wanted = motor - (push - rubbing) / held;
        int loose;
        speed = fmax(fmin(wanted, (gap - s->place) / h), (-gap - s->place) / h);
        loose = speed >= wanted && speed <= wanted;
        s->place += h * speed;
        s->rate = loose ? 2.0 * speed - s->rate : 0.0;
        s->pushed = loose ? rubbing - g->dry * sign : 0.0;
    }
    if (s->steps > 1 && h > 0.0)
        second = 2.0 * (speed - s->speed) / (h + s->h);
    if (h > 0.0 || s->steps == 0) {
        s->steps = s->steps < 2 ? s->steps + 1 : 2;
        s->speed = speed;
        s->h = h;
        for (j = 0; j < 6; j++)
            s->road[j] = now[j];
    }
    @robot@_derivative(@robot@_load_links, q, v, a, i, -g->unit * s->place, -g->unit * speed, -g->unit * second, out);
    out[i] += g->unit * s->pushed;
}
