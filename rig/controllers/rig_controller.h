/* rig_controller.h: a controller of friction-rig in C (or any language with C linkage).
 *
 * A library defines three symbols: rig_controller_about, rig_controller_init, rig_controller_step. Compile it with
 *
 *     gcc -O2 -shared -fPIC -I FOLDER_OF_THIS_HEADER controller.c -o controller.so
 *
 * and name it in a scene: kind = "c", file = "./controller.so". All units are SI without prefix, as texts: "m/s", "N".
 * Time is simulated time [ns]. Keep nothing in variables of your own between two calls: what a controller remembers is
 * its state, which it receives and returns. Then the same library gives the same bits live, simulated and verified.
 */
#ifndef RIG_CONTROLLER_H
#define RIG_CONTROLLER_H

#include <stdint.h>

#define RIG_CONTROLLER_VERSION 1 /* changes when something in this file changes its meaning */

#ifdef __cplusplus
extern "C" {
#endif

struct rig_signal {
    const char *name; /* sensor or actuator as scenes call it ("vibrometer", "load.force"), unless the scene names others */
    const char *unit; /* "m/s"; "1" without unit */
};

struct rig_parameter {
    const char *name;        /* letters, digits and _: a key of the scene, and what `rig live tune` changes */
    const char *unit;        /* "N*s/m" */
    double value, low, high; /* default, and the range that is allowed */
};

struct rig_controller {
    int32_t version;   /* RIG_CONTROLLER_VERSION */
    int32_t size;      /* sizeof(struct rig_controller) */
    int64_t period_ns; /* time between two steps, unless the scene states another period */
    int32_t inputs, outputs, parameters, states; /* numbers of each; states may be 0 */
    const struct rig_signal *input;
    const struct rig_signal *output;
    const struct rig_parameter *parameter;
};

extern const struct rig_controller rig_controller_about;

/* Write the state before the first step. Return 0, or another number for parameters that cannot be used. */
int rig_controller_init(const double *parameters, double *state);

/* Read `state` and `input` (all finite), write `next` and `output`. Return 0; another number ends the controller. */
int rig_controller_step(const double *parameters, const double *state, double *next, int64_t t_ns, const double *input,
                        double *output);

#ifdef __cplusplus
}
#endif
#endif
