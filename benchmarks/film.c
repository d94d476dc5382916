/* C twin of rig.solve.film_steps: friction along the travel alone, no damping of the film, no instruments. Every sum has the
   kernel's order, so that the results have its bits; loops are cut as they are fastest in C.
   Compiled with -O3 -march=native and these constants, which the kernel has as shapes: NQ coordinates, NA of them that
   move both sides alike and NO against each other, M signals, R riders; PAIRS of points, WIDTH lanes of a row,
   ROOM for the points in one of a rider. */
#include <stdint.h>

#define POINTS (2 * PAIRS)
#define LANES 4
#define USED ((POINTS + LANES - 1) / LANES) /* vectors of a row that are not filling */
#define CUTS ((USED + 5) / 6)
#define SUMS ((USED + CUTS - 1) / CUTS) /* vectors of sums that are kept in registers at a time */
_Static_assert(CUTS * SUMS * LANES <= WIDTH, "a row has room for whole cuts");
typedef double lanes __attribute__((vector_size(8 * LANES), aligned(8)));

typedef struct {
    const double *alike, *against; /* [place][coordinate][WIDTH] */
    const int64_t *which_alike, *which_against;
    const double *kick, *turn, *loss, *column, *push, *signal, *riders, *advance;
    double pitch, stiffness, shear, mu;
    int64_t places, pushed, travel;
} Film;

#define WHOLE_LINES __attribute__((aligned(64))) /* of the processor's cache */
static double rise_alike[NA * WIDTH] WHOLE_LINES, rise_against[NO * WIDTH] WHOLE_LINES;
static double now_alike[NA * WIDTH] WHOLE_LINES, now_against[NO * WIDTH] WHOLE_LINES;
static double felt_alike[WIDTH] WHOLE_LINES, felt_against[WIDTH] WHOLE_LINES;
static double seen[2][POINTS] WHOLE_LINES, last[2][POINTS] WHOLE_LINES, gives[2][POINTS] WHOLE_LINES;
static double deep[ROOM] WHOLE_LINES, before[NQ] WHOLE_LINES;

static inline lanes at(const double *from) { return *(const lanes *)from; }

/* now = low + share rise, out = sum_j x[j] now[j] */
static inline void blend(const double *low, const double *rise, double share, const double *x, int count, double *now,
                         double *out) {
    for (int b = 0; b < CUTS * SUMS * LANES; b += SUMS * LANES) {
        lanes s[SUMS] = {{0}};
        for (int j = 0; j < count; j++)
            for (int k = 0; k < SUMS; k++) {
                int to = j * WIDTH + b + k * LANES;
                lanes row = at(low + to) + share * at(rise + to);
                *(lanes *)(now + to) = row;
                s[k] += row * x[j];
            }
        for (int k = 0; k < SUMS; k++) *(lanes *)(out + b + k * LANES) = s[k];
    }
}

/* out[j] = sum of table[j] weights over the vectors of a row: each of 16 lanes by itself, then by halves */
static inline void across(const double *table, const double *weights, int count, int width, double *out) {
    for (int j = 0; j < count; j++) {
        lanes s[16 / LANES] = {{0}}, whole;
        for (int k = 0; k < USED; k++) s[k % (16 / LANES)] += at(weights + k * LANES) * at(table + j * width + k * LANES);
        whole = (s[0] + s[2]) + (s[1] + s[3]);
        out[j] = (whole[0] + whole[2]) + (whole[1] + whole[3]);
    }
}

/* Where the points are; `risen`: the place whose rise to the next one is at hand, `share`: of it that the rows have.
   `anew`: rows are made from those of the place, else from those of the step before. */
static void look(const Film *f, const double *x, double travel, int64_t *risen, double *share, int anew) {
    double place = travel / f->pitch, a[NA], o[NO];
    int64_t low = place < 0.0 ? 0 : (int64_t)place;
    if (low > f->places - 2) low = f->places - 2;
    for (int j = 0; j < NA; j++) a[j] = x[f->which_alike[j]];
    for (int j = 0; j < NO; j++) o[j] = x[f->which_against[j]];
    const double *alike = f->alike + low * NA * WIDTH, *against = f->against + low * NO * WIDTH;
    if (low != *risen) {
        for (int k = 0; k < NA * WIDTH; k++) rise_alike[k] = alike[NA * WIDTH + k] - alike[k];
        for (int k = 0; k < NO * WIDTH; k++) rise_against[k] = against[NO * WIDTH + k] - against[k];
        *risen = low, anew = 1;
    }
    double part = anew ? place - low : place - low - *share;
    blend(anew ? alike : now_alike, rise_alike, part, a, NA, now_alike, felt_alike);
    blend(anew ? against : now_against, rise_against, part, o, NO, now_against, felt_against);
    *share = place - low;
    for (int d = 0; d < 2; d++)
        for (int i = 0; i < PAIRS; i++) {
            seen[d][i] = felt_alike[d * PAIRS + i] + felt_against[d * PAIRS + i];
            seen[d][PAIRS + i] = felt_alike[d * PAIRS + i] - felt_against[d * PAIRS + i];
        }
}

/* Kick the coordinates by half a step, carry them and the signals over a whole one. Returns the work of the signals. */
static double flow(const Film *f, double *x, double *signals, double *since, const double *forces, double *damped) {
    double *places = x, *speeds = x + NQ, moved[M], held = places[f->pushed], work = 0.0;
    const double *qq = f->loss, *qv = qq + NQ, *vv = qv + NQ;
    const double *by_place = f->turn, *by_speed = by_place + NQ, *turned = by_speed + NQ, *slowed = turned + NQ;
    for (int i = 0; i < NQ; i++) before[i] = speeds[i] + f->kick[i] * forces[i];
    for (int i = 0; i < NQ; i++)
        damped[i] += qq[i] * places[i] * places[i] + qv[i] * places[i] * before[i] + vv[i] * before[i] * before[i];
    for (int i = 0; i < NQ; i++) speeds[i] = before[i] + (turned[i] * places[i] + slowed[i] * before[i]);
    for (int i = 0; i < NQ; i++) places[i] += by_place[i] * places[i] + by_speed[i] * before[i];
    double mean = 0.0, further = 0.0, faster = 0.0;
    for (int j = 0; j < M; j++) {
        double s = 0.0;
        for (int k = 0; k < M; k++) s += f->signal[j * M + k] * signals[k];
        moved[j] = s;
    }
    for (int j = 0; j < M; j++) {
        further += f->column[j] * signals[j];
        faster += f->column[M + j] * signals[j];
        mean += f->push[j] * (signals[j] + 0.5 * moved[j]);
    }
    work = mean * (places[f->pushed] + further - held);
    places[f->pushed] += further;
    speeds[f->pushed] += faster;
    for (int j = 0; j < M; j++) signals[j] += moved[j];
    for (int j = 0; j < M; j++) since[j] += moved[j];
    return work;
}

static int press(const Film *f, double *restrict normal, double *restrict friction, double travelled,
                 double *restrict given, double *restrict slid_off) {
    const double k = f->stiffness, shear = f->shear, mu = f->mu, give = 1.0 / shear;
    double ahead[R], *place = seen[0], *carried = seen[1], *was = last[1];
    int64_t opened = 0;
    for (int i = 0; i < POINTS; i++) deep[i] = place[i] > 0.0 ? place[i] : 0.0;
    across(f->riders, deep, R, ROOM, ahead);
    for (int i = 0; i < POINTS; i++) deep[i] = place[i];
    for (int r = 0; r < R; r++) {
        const double by = k * f->advance[r] * ahead[r], *restrict rider = f->riders + r * ROOM;
        for (int i = 0; i < POINTS; i++) deep[i] -= by * rider[i];
    }
    for (int i = 0; i < POINTS; i++) {
        double force = k * (deep[i] > 0.0 ? deep[i] : 0.0);
        opened += (normal[i] > 0.0) & (force == 0.0);
        normal[i] = force;
    }
    for (int i = 0; i < POINTS; i++) gives[0][i] = -normal[i];
    for (int i = 0; i < POINTS; i++) {
        double most = mu * normal[i], moved = friction[i] + shear * (travelled - (carried[i] - was[i]));
        moved = moved > -most ? moved : -most;
        gives[1][i] = moved < most ? moved : most;
    }
    for (int i = 0; i < POINTS; i++) given[i] += 0.5 * (friction[i] + gives[1][i]) * travelled;
    for (int i = 0; i < POINTS; i++) {
        double slid = travelled - (carried[i] - was[i]) - give * (gives[1][i] - friction[i]);
        slid_off[i] += 0.5 * (friction[i] + gives[1][i]) * slid;
    }
    for (int i = 0; i < POINTS; i++) friction[i] = gives[1][i];
    return (int)opened;
}

static void push(const Film *f, double *forces) {
    double a[NA], o[NO];
    for (int d = 0; d < 2; d++)
        for (int i = 0; i < PAIRS; i++) {
            felt_alike[d * PAIRS + i] = gives[d][i] + gives[d][PAIRS + i];
            felt_against[d * PAIRS + i] = gives[d][i] - gives[d][PAIRS + i];
        }
    across(now_alike, felt_alike, NA, WIDTH, a);
    across(now_against, felt_against, NO, WIDTH, o);
    for (int j = 0; j < NA; j++) forces[f->which_alike[j]] = a[j];
    for (int j = 0; j < NO; j++) forces[f->which_against[j]] = o[j];
}

/* x: places, speeds [NQ], signals [M], forces [NQ], `sums` numbers, then of the points normal force and friction.
   energy [4]: to the points, lost in sliding, in dampers, of the load. Returns how many points have opened. */
int64_t film_run(const Film *f, int64_t ticks, int64_t substeps, int64_t sums, double *x, double *energy) {
    double *signals = x + 2 * NQ, *forces = signals + M, *normal = forces + NQ + sums, *friction = normal + POINTS;
    double damped[NQ] = {0}, given[POINTS] = {0}, slid_off[POINTS] = {0}, begun[M] = {0}, since[M] = {0};
    int64_t opened = 0, risen = -1;
    double share = 0.0;
    look(f, x, signals[f->travel], &risen, &share, 1);
    for (int64_t n = 0; n < ticks * substeps; n++) {
        if (n % substeps == 0)
            for (int j = 0; j < M; j++) begun[j] = signals[j], since[j] = 0.0;
        double travelled = signals[f->travel];
        energy[3] += flow(f, x, signals, since, forces, damped);
        travelled = signals[f->travel] - travelled;
        for (int d = 0; d < 2; d++)
            for (int i = 0; i < POINTS; i++) last[d][i] = seen[d][i];
        look(f, x, signals[f->travel], &risen, &share, n % substeps == 0);
        opened += press(f, normal, friction, travelled, given, slid_off);
        push(f, forces);
        for (int i = 0; i < NQ; i++) x[NQ + i] += f->kick[i] * forces[i];
        if (n % substeps == substeps - 1)
            for (int j = 0; j < M; j++) signals[j] = begun[j] + since[j];
    }
    for (int i = 0; i < NQ; i++) energy[2] += damped[i];
    for (int i = 0; i < POINTS; i++) {
        energy[0] += given[i];
        energy[1] += slid_off[i];
    }
    return opened;
}
