/* Normal-force feedback F_N = F0 - K v, as of the scene belt_normal_force. Compile with -ffp-contract=off: a fused
   multiplication and addition rounds differently. Replace this law by your own. */
#define INPUTS 1
#define OUTPUTS 1
#include "rig_board.h"

#ifndef NOMINAL
#define NOMINAL 20.0        /* F0 [N] */
#define GAIN 200.0          /* K [N s/m] */
#define HIGHEST 100.0       /* [N] */
#define ENABLE_NS 4000000000
#endif

static double smooth; /* the filtered velocity [m/s]; here the filter is open, smooth = v up to rounding */
static int fresh;

void law_start(void) { fresh = 1; }

void law(int64_t t_ns, const double *in, double *out)
{
    double force = NOMINAL;
    if (fresh) smooth = in[0];
    fresh = 0;
    smooth += in[0] - smooth;
    if (t_ns >= ENABLE_NS) force = NOMINAL - GAIN * smooth;
    out[0] = force < 0.0 ? 0.0 : force > HIGHEST ? HIGHEST : force;
}
