/* C twin of rig.solve.film_steps for points that stay in place: uncoupled coordinates, no mirror symmetry, no damping of the
   film, no instruments; the load acts on every coordinate. Every sum has the kernel's order, so that the results have its bits.
   Constants: NQ coordinates, M signals, POINTS; WIDTH lanes of a row, BACK coordinates of a column, both padded. */
#include <stdint.h>

#define LANES 8
typedef double lanes __attribute__((vector_size(8 * LANES), aligned(8)));
#define WHOLE_LINES __attribute__((aligned(64)))

typedef struct {
    const double *now, *back; /* rows [coordinate][WIDTH], the same transposed [2 POINTS][BACK] */
    const double *kick, *turn, *loss, *column, *push, *signal, *stiffness, *shear, *give, *mu, *reach;
    int64_t slid, ticks, substeps, sums;
} Points;

static double felt[WIDTH] WHOLE_LINES, forces_of[BACK] WHOLE_LINES, last[2][POINTS] WHOLE_LINES, seen[2][POINTS] WHOLE_LINES;
static double before[NQ] WHOLE_LINES, pull[POINTS] WHOLE_LINES, slips[POINTS] WHOLE_LINES, most[POINTS] WHOLE_LINES;

static inline lanes at(const double *from) { return *(const lanes *)from; }

/* out = sum_j x[j] table[j], the sums of a whole row in registers */
#define ALONG(NAME, COUNT, ROOM)                                                                                         \
    static inline void NAME(const double *table, const double *x, double *out) {                                         \
        lanes s[ROOM / LANES] = {{0}};                                                                                   \
        for (int j = 0; j < COUNT; j++)                                                                                  \
            for (int k = 0; k < ROOM / LANES; k++) s[k] += x[j] * at(table + j * ROOM + k * LANES);                      \
        for (int k = 0; k < ROOM / LANES; k++) *(lanes *)(out + k * LANES) = s[k];                                       \
    }
ALONG(to_points, NQ, WIDTH)
ALONG(to_coordinates, 2 * POINTS, BACK)

static void look(const Points *f, const double *x) {
    to_points(f->now, x, felt);
    for (int d = 0; d < 2; d++)
        for (int i = 0; i < POINTS; i++) {
            last[d][i] = seen[d][i];
            seen[d][i] = felt[d * POINTS + i];
        }
}

static double flow(const Points *f, double *x, double *signals, double *since, const double *forces, double *damped) {
    double *places = x, *speeds = x + NQ, moved[M], held[NQ], work = 0.0;
    const double *qq = f->loss, *qv = qq + NQ, *vv = qv + NQ;
    const double *by_place = f->turn, *by_speed = by_place + NQ, *turned = by_speed + NQ, *slowed = turned + NQ;
    for (int i = 0; i < NQ; i++) held[i] = places[i];
    for (int i = 0; i < NQ; i++) before[i] = speeds[i] + f->kick[i] * forces[i];
    for (int i = 0; i < NQ; i++)
        damped[i] += qq[i] * places[i] * places[i] + qv[i] * places[i] * before[i] + vv[i] * before[i] * before[i];
    for (int i = 0; i < NQ; i++) speeds[i] = before[i] + (turned[i] * places[i] + slowed[i] * before[i]);
    for (int i = 0; i < NQ; i++) places[i] += by_place[i] * places[i] + by_speed[i] * before[i];
    for (int j = 0; j < M; j++) {
        double s = 0.0;
        for (int k = 0; k < M; k++) s += f->signal[j * M + k] * signals[k];
        moved[j] = s;
    }
    for (int i = 0; i < NQ; i++) {
        double mean = 0.0, further = 0.0, faster = 0.0;
        for (int j = 0; j < M; j++) {
            further += f->column[j * NQ + i] * signals[j];
            faster += f->column[(M + j) * NQ + i] * signals[j];
            mean += f->push[j * NQ + i] * (signals[j] + 0.5 * moved[j]);
        }
        work += mean * (places[i] + further - held[i]);
        places[i] += further;
        speeds[i] += faster;
    }
    for (int j = 0; j < M; j++) signals[j] += moved[j], since[j] += moved[j];
    return work;
}

static int64_t press(const Points *f, double *restrict normal, double *restrict friction, double travelled,
                     double *restrict given, double *restrict slid_off) {
    int64_t opened = 0;
    for (int i = 0; i < POINTS; i++) {
        double force = f->stiffness[i] * (seen[0][i] > 0.0 ? seen[0][i] : 0.0);
        opened += (normal[i] > 0.0) & (force == 0.0);
        normal[i] = force;
    }
    for (int i = 0; i < POINTS; i++) slips[i] = f->reach[i] * travelled - (seen[1][i] - last[1][i]);
    for (int i = 0; i < POINTS; i++) {
        most[i] = f->mu[i] * normal[i];
        double moved = friction[i] + f->shear[i] * slips[i];
        moved = moved > -most[i] ? moved : -most[i];
        pull[i] = moved < most[i] ? moved : most[i];
    }
    for (int i = 0; i < POINTS; i++) given[i] += 0.5 * (friction[i] + pull[i]) * (f->reach[i] * travelled);
    for (int i = 0; i < POINTS; i++)
        slid_off[i] += 0.5 * (friction[i] + pull[i]) * (slips[i] - f->give[i] * (pull[i] - friction[i]));
    for (int i = 0; i < POINTS; i++) friction[i] = pull[i];
    return opened;
}

/* x: places, speeds [NQ], signals [M], forces [NQ], `sums` numbers, then of the points normal force and friction.
   energy [4]: to the points, lost in sliding, in dampers, of the load. Returns how many points have opened. */
int64_t points_run(const Points *f, double *x, double *energy) {
    double *signals = x + 2 * NQ, *forces = signals + M, *normal = forces + NQ + f->sums, *friction = normal + POINTS;
    double damped[NQ] = {0}, given[POINTS] = {0}, slid_off[POINTS] = {0}, begun[M] = {0}, since[M] = {0};
    int64_t opened = 0;
    look(f, x);
    for (int64_t n = 0; n < f->ticks * f->substeps; n++) {
        if (n % f->substeps == 0)
            for (int j = 0; j < M; j++) begun[j] = signals[j], since[j] = 0.0;
        double travelled = signals[f->slid];
        energy[3] += flow(f, x, signals, since, forces, damped);
        travelled = signals[f->slid] - travelled;
        look(f, x);
        opened += press(f, normal, friction, travelled, given, slid_off);
        for (int i = 0; i < POINTS; i++) felt[i] = -normal[i], felt[POINTS + i] = friction[i];
        to_coordinates(f->back, felt, forces_of);
        for (int i = 0; i < NQ; i++) forces[i] = forces_of[i], x[NQ + i] += f->kick[i] * forces[i];
        if (n % f->substeps == f->substeps - 1)
            for (int j = 0; j < M; j++) signals[j] = begun[j] + since[j];
    }
    for (int i = 0; i < NQ; i++) energy[2] += damped[i];
    for (int i = 0; i < POINTS; i++) energy[0] += given[i], energy[1] += slid_off[i];
    return opened;
}
