/* C twin of a whole run in open loop, at the exact method and without a subdivision of ticks: motion, events, energy
   balance, instruments and outputs of one oscillator with one friction patch. Compiled as twins.c, with OUTPUTS of the rig,
   of which instruments read the first READ, and TERMS of the energy balance as further constants. */
#include "twins.c"
#include <complex.h>

#define ORDER 8
#define WEIGHTS (ORDER + 2)
#define NODES 8
#define WATCHED 1
enum { STATE, POLE, RESIDUE, STEP, PART = STEP + WEIGHTS, PEEK = PART + WEIGHTS, COLUMNS = PEEK + WEIGHTS };

/* rig.solve.sampling.INSTRUMENT */
typedef struct {
    int64_t column, period, rest, samples, cycle;
    double mean;
    int64_t delay, first, last, echo, silence, averages, holds;
    double direct, gain, offset, slope, warmth, fade, rise, noise, low, high, resolution, slew;
    int64_t dropouts, most, taken, published, kept, drawn, gap, lost_until;
    double followed, previous, part, peek;
    int64_t clipped, dropped_out, slew_lost;
} Instrument;

/* Tables by mode set: signals [OUTPUTS][N], work and powers [TERMS][N][N], active [TERMS]. noise [instrument][room],
   gaps [instrument][most][2] in ns, bound of output WATCHED. */
typedef struct {
    const double *signals, *work, *powers, *nodes, *weights, *noise;
    const int64_t *active, *gaps;
    int64_t instruments, room, most;
    double bound;
} Whole;

static int64_t pieces;
static double start[64], length[64], coef[64][READ][ORDER + 1];

/* Write the outputs that are read over `h` s from x as polynomials. */
static void emit(const Rig *r, const Whole *w, int mode, const double *x, double at, double h) {
    double d[ORDER + 1][N];
    int top = 0;
    memcpy(d[0], x, sizeof(d[0]));
    for (int zero = 0; top < ORDER; top++) {
        zero = 1;
        for (int i = 0; i < N; i++) zero &= d[top][i] == 0.0;
        if (zero) break;
        for (int i = 0; i < N; i++) d[top + 1][i] = h / (top + 1) * dot(r->A + (mode * N + i) * N, d[top]);
    }
    for (int s = 0; s < READ; s++)
        for (int k = 0; k <= ORDER; k++) coef[pieces][s][k] = k > top ? 0.0 : dot(w->signals + (mode * OUTPUTS + s) * N, d[k]);
    start[pieces] = at;
    length[pieces++] = h;
}

static void add(const double *form, const int64_t *active, const double *x, double scale, double *energy) {
    for (int term = 0; term < TERMS; term++)
        if (active[term]) {
            double s = 0.0;
            for (int i = 0; i < N; i++) s += x[i] * dot(form + (term * N + i) * N, x);
            energy[term] += scale * s;
        }
}

/* The rest of one tick from place *u in it: the guard that fell, or -1 at its end. */
static int rest(const Rig *r, const Whole *w, int mode, double *x, const double *size, double *u, double *energy) {
    static double d[DEGREE + 1][N];
    int terms = (int)r->order[mode], guard = -1;
    const int64_t *active = w->active + mode * TERMS;
    double y[N], poly[DEGREE + 1], h = (1.0 - *u) * r->step, first = NONE;
    if (*u == 0.0) {
        const double *E = r->E + mode * r->levels * N * N;
        for (int i = 0; i < N; i++) y[i] = x[i] + dot(E + i * N, x);
        if (certified(r, mode, x, y, 1.0)) {
            emit(r, w, mode, x, 0.0, h);
            add(w->work + mode * TERMS * N * N, active, x, 1.0, energy);
            memcpy(x, y, sizeof(y));
            return -1;
        }
    }
    memcpy(d[0], x, sizeof(y));
    for (int k = 1; k <= terms; k++)
        for (int i = 0; i < N; i++) d[k][i] = h / k * dot(r->A + (mode * N + i) * N, d[k - 1]);
    for (int k = 0; k < r->count[mode]; k++) {
        const double *G = r->G + (mode * 2 + k) * N;
        for (int q = 0; q <= terms; q++) poly[q] = dot(G, d[q]);
        double fall = first_fall(r->bernstein, poly, terms, rounding(G, size));
        if (fall < first) first = fall, guard = k;
    }
    double reach = guard < 0 ? 1.0 : first;
    if (reach > 0.0) {
        emit(r, w, mode, x, *u * r->step, reach * h);
        for (int q = 0; q < NODES; q++) {
            along(d, terms, w->nodes[q] * reach, y);
            add(w->powers + mode * TERMS * N * N, active, y, w->weights[q] * reach * h, energy);
        }
        along(d, terms, reach, x);
    }
    *u = guard < 0 ? 0.0 : *u + reach * (1.0 - *u);
    return guard;
}

static void prepare(double complex *pole, double h) {
    double complex x = pole[POLE] * h, e = creal(x) > -700.0 ? cexp(x) : 0.0, w, term;
    double size = cabs(x);
    int upward = size >= ORDER ? ORDER : (int)size, lowest = 0;
    pole[PART] = e;
    if (upward > 0) {
        pole[PART + 1] = h * (w = (e - 1.0) / x);
        for (int k = 1; k <= upward; k++) pole[PART + 1 + k] = h * (w = (k * w - 1.0) / x);
        lowest = upward + 1;
    }
    if (lowest <= ORDER) {
        w = term = 1.0 / (ORDER + 1);
        for (int m = ORDER + 2; fabs(creal(term)) + fabs(cimag(term)) > 1e-18; m++) w += term *= x / m;
        pole[PART + 1 + ORDER] = h * w;
        for (int k = ORDER; k > lowest; k--) pole[PART + k] = h * (w = (1.0 + x * w) / k);
    }
}

static double sample(Instrument *s, double x, int64_t t, const double *noise, const int64_t *gaps, int64_t most) {
    x *= s->gain;
    double change = x - s->followed;
    if (change > s->slew) x = s->followed + s->slew, s->slew_lost++;
    else if (change < -s->slew) x = s->followed - s->slew, s->slew_lost++;
    s->followed = x;
    double seconds = (t > 0 ? t : 0) * 1e-9, y = x + s->offset + s->slope * seconds;
    if (s->warmth != 0.0) y += s->warmth * ((s->fade != 0.0 ? exp(-s->fade * seconds) : 1.0) - exp(-s->rise * seconds));
    if (s->noise > 0.0) y += s->noise * noise[s->drawn++];
    if (y > s->high) y = s->high, s->clipped++;
    else if (y < s->low) y = s->low, s->clipped++;
    if (s->resolution > 0.0) y = rint(y / s->resolution) * s->resolution;
    if (s->dropouts) {
        for (; s->gap < most && gaps[2 * s->gap] <= t; s->gap++)
            if (gaps[2 * s->gap + 1] > s->lost_until) s->lost_until = gaps[2 * s->gap + 1];
        if (t < s->lost_until) y = s->holds ? s->previous : 0.0, s->dropped_out++;
    }
    s->taken++;
    return s->previous = y;
}

/* One instrument over the pieces of a tick, at whose end it takes a sample. */
static double measured(const Rig *r, Instrument *s, double complex *poles, const double *noise, const int64_t *gaps,
                       int64_t most) {
    double y = 0.0;
    for (int64_t j = 0; j < pieces; j++) {
        const double *c = coef[j][s->column];
        double h = length[j], x = 0.0, base = 0.0;
        int at = STEP, degree = ORDER;
        while (degree > 4 && c[degree] == 0.0) degree--;
        if (fabs(h - r->step) > 4e-15 * r->step) {
            at = PART;
            if (fabs(h - s->part) > 4e-15 * r->step) {
                s->part = h;
                for (int64_t p = s->first; p < s->last; p++) prepare(poles + p * COLUMNS, h);
            }
        }
        for (int64_t p = s->first; p < s->last; p++) {
            double complex *pole = poles + p * COLUMNS, z = pole[at] * pole[STATE];
            double re = creal(z), im = cimag(z);
            for (int k = 0; k <= degree; k++) re += creal(pole[at + 1 + k]) * c[k], im += cimag(pole[at + 1 + k]) * c[k];
            x += creal(pole[RESIDUE]) * re - cimag(pole[RESIDUE]) * im;
            pole[STATE] = fabs(re) + fabs(im) < 1e-250 ? 0.0 : re + im * I;
        }
        if (j == pieces - 1) {
            base = x;
            if (s->direct != 0.0) x += s->direct * value(c, 0, ORDER, 1.0);
            y = sample(s, x, s->taken * s->period - s->delay, noise, gaps, most);
        }
        if (s->averages) poles[s->first * COLUMNS + STATE] -= base / creal(poles[s->first * COLUMNS + RESIDUE]);
    }
    return y;
}

/* outputs [OUTPUTS][ticks], samples [instrument][ticks], energy [TERMS]. Returns the number of events. */
int64_t whole_run(const Rig *r, const Whole *w, int64_t ticks, int mode, double *x, double *size, Instrument *instruments,
                  double complex *poles, double *outputs, double *samples, double *energy, int64_t *event_tick,
                  double *event_place) {
    double u = 0.0, g[2], x0[N], next[N];
    int64_t tick = 0, events = 0;
    int pending = SETTLE, repeat = 0;
    pieces = 0;
    while (tick < ticks) {
        if (u == 0.0 && pieces == 0)
            for (int i = 0; i < N; i++) size[i] = fmax(size[i], fabs(x[i]));
        if (pending != READY) mode = settle(r, mode, pending, x, size, repeat > 1 ? SLACK : 0.0), pending = READY;
        const double *G = r->G + mode * 2 * N;
        int quietly = 0, guard = -1;
        if (u == 0.0) {
            for (int k = 0; k < r->count[mode]; k++) g[k] = dot(G + k * N, x);
            memcpy(x0, x, sizeof(x0));
            quietly = (int)quiet(r->E + mode * r->levels * N * N, G, r->B + mode * 2 * N, r->count[mode], x, g, 1, next);
        }
        if (quietly) {
            emit(r, w, mode, x0, 0.0, r->step);
            add(w->work + mode * TERMS * N * N, w->active + mode * TERMS, x0, 1.0, energy);
        } else guard = rest(r, w, mode, x, size, &u, energy);
        if (guard >= 0) {
            int same = events > 0 && event_tick[events - 1] == tick && fabs(event_place[events - 1] - u) < 1e-12;
            repeat = same ? repeat + 1 : 0;
            event_tick[events] = tick;
            event_place[events++] = u;
            mode = mode == 2 ? guard : 2;
            pending = LAND;
            continue;
        }
        for (int k = 0; k < OUTPUTS; k++) outputs[k * ticks + tick] = dot(w->signals + (mode * OUTPUTS + k) * N, x);
        for (int64_t i = 0; i < w->instruments; i++)
            samples[i * ticks + tick] = measured(r, instruments + i, poles, w->noise + i * w->room, w->gaps + i * 2 * w->most, w->most);
        pieces = 0;
        if (!(fabs(outputs[WATCHED * ticks + tick]) <= w->bound)) break;
        tick++;
    }
    return events;
}
