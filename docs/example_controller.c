/* Presses lightly while the body runs with the belt and hard while it runs against it: example_controller.py in C. */
#include "rig_controller.h"

static const struct rig_signal input[] = {{"vibrometer", "m/s"}};
static const struct rig_signal output[] = {{"load.force", "N"}};
static const struct rig_parameter parameter[] = {
    {"nominal", "N", 20.0, 0.0, 100.0},
    {"swing", "N", 10.0, 0.0, 50.0},
    {"band", "m/s", 0.005, 1e-6, 1.0}, /* full swing beyond this filtered speed */
    {"filter", "s", 0.001, 0.0, 1.0},  /* time constant */
};
const struct rig_controller rig_controller_about = {
    RIG_CONTROLLER_VERSION, sizeof(struct rig_controller), 1000000, 1, 1, 4, 1, input, output, parameter};

int rig_controller_init(const double *p, double *state)
{
    state[0] = 0.0; /* the filtered speed */
    return 0;
}

int rig_controller_step(const double *p, const double *state, double *next, int64_t t_ns, const double *in, double *out)
{
    double period = 0.001, v = state[0] + period / (period + p[3]) * (in[0] - state[0]);
    double share = v / p[2];
    share = share > 1.0 ? 1.0 : share < -1.0 ? -1.0 : share;
    next[0] = v;
    out[0] = p[0] - p[1] * share;
    return 0;
}
