/* C twins of kernels of rig.solve, statement for statement: the quiet tick of the exact method, and the whole runs, at a
   fixed step and exact, of one oscillator with one friction patch under Coulomb friction (mode sets 0 slip+, 1 slip-,
   2 stick).
   Compiled with -O3 -march=native and the number of states N as a constant, as the kernels have it. */
#include <math.h>
#include <stdint.h>
#include <string.h>

#define ROUND (64.0 * 2.2e-16)

static inline double dot(const double *r, const double *x) {
    double s = 0.0;
    for (int j = 0; j < N; j++) s += r[j] * x[j];
    return s;
}

static inline double rounding(const double *r, const double *x) {
    double s = 0.0;
    for (int j = 0; j < N; j++) s += fabs(r[j] * x[j]);
    return s * ROUND;
}

int64_t quiet(const double *E, const double *G, const double *B, int64_t count, double *x, double *g, int64_t ticks,
              double *out) {
    for (int64_t tick = 0; tick < ticks; tick++) {
        double *y = out + tick * N;
        for (int i = 0; i < N; i++) {
            double s = 0.0;
            for (int j = 0; j < N; j++) s += E[i * N + j] * x[j];
            y[i] = x[i] + s;
        }
        for (int64_t k = 0; k < count; k++) {
            double after = 0.0, bound = 0.0;
            for (int j = 0; j < N; j++) {
                after += G[k * N + j] * y[j];
                bound += B[k * N + j] * fabs(x[j]);
            }
            if (!(g[k] > bound && after > bound)) {
                for (int64_t q = 0; q < count; q++) g[q] = dot(G + q * N, x);
                return tick;
            }
            g[k] = after;
        }
        for (int i = 0; i < N; i++) x[i] = y[i];
    }
    return ticks;
}

static inline void rate(const double *A, const double *x, double *k) {
    for (int i = 0; i < N; i++) k[i] = dot(A + i * N, x);
}

static inline void move(const double *A, double k[4][N], const double *x, double h, double *y) {
    double z[N];
    for (int stage = 0; stage < 3; stage++) {
        double reach = stage == 2 ? h : 0.5 * h;
        for (int i = 0; i < N; i++) z[i] = x[i] + reach * k[stage][i];
        rate(A, z, k[stage + 1]);
    }
    for (int i = 0; i < N; i++) y[i] = x[i] + (h / 6.0) * (k[0][i] + 2.0 * (k[1][i] + k[2][i]) + k[3][i]);
}

static inline int fell(const double *G, int count, const double *x, const double *y) {
    int fallen = -1;
    for (int g = 0; g < count; g++)
        if (fallen < 0 && dot(G + g * N, y) <= 0.0)
            if (dot(G + g * N, x) > rounding(G + g * N, x) || dot(G + g * N, y) < -rounding(G + g * N, y)) fallen = g;
    return fallen;
}

/* A [3][N][N], G [3][2][N], count [3], landing [N][N], slip [N], need [N] (reaction in stick), load [N], mu_static. */
int64_t rk4_run(const double *A, const double *G, const int64_t *count, const double *landing, const double *slip,
                const double *need, const double *load, double mu_static, double step, int64_t substeps, int64_t ticks,
                int mode, double *x, double *out, int64_t *event_tick, double *event_place, int64_t *final_mode) {
    double k[4][N], y[N], full = step / substeps, u = 0.0;
    int64_t tick = 0, events = 0;
    while (tick < ticks) {
        const double *a = A + mode * N * N, *g = G + mode * 2 * N;
        double position = u * substeps;
        int64_t whole = (int64_t)(position + 1e-12) + 1;
        double h = position - (whole - 1) <= 1e-12 ? full : (whole - position) * full;
        rate(a, x, k[0]);
        move(a, k, x, h, y);
        int fallen = fell(g, (int)count[mode], x, y);
        double length = h;
        if (fallen >= 0) {
            double low = 0.0, high = h;
            for (int i = 0; i < 60; i++) {
                double middle = 0.5 * (low + high);
                if (middle <= low || middle >= high) break;
                move(a, k, x, middle, y);
                if (fell(g, (int)count[mode], x, y) >= 0) high = middle;
                else low = middle;
            }
            move(a, k, x, high, y);
            length = high;
            fallen = fell(g, (int)count[mode], x, y);
            if (fallen < 0) fallen = 0;
        }
        memcpy(x, y, sizeof(y));
        if (fallen >= 0) {
            u = fmin((position + length / full) / substeps, 1.0 - 1.2e-16);
            event_tick[events] = tick;
            event_place[events++] = u;
            if (mode == 2) mode = fallen == 0 ? 0 : 1;
            else { /* land, then stick or slip by the force that sticking needs */
                double copy[N];
                memcpy(copy, x, sizeof(copy));
                for (int i = 0; i < N; i++) x[i] = dot(landing + i * N, copy);
                double wanted = dot(need, x), limit = mu_static * dot(load, x);
                mode = fabs(wanted) > limit ? (wanted > 0.0 ? 0 : 1) : 2;
            }
            double w = dot(slip, x);
            if (mode != 2 && (mode == 0 ? w : -w) < -rounding(slip, x)) mode = w > 0.0 ? 0 : 1;
            continue;
        }
        if (whole >= substeps) {
            memcpy(out + tick * N, x, sizeof(y));
            tick++;
            u = 0.0;
        } else u = (double)whole / substeps;
    }
    *final_mode = mode;
    return events;
}

/* The exact run of one oscillator with one friction patch that never opens: quiet ticks, opened ticks, events. */
#define DEGREE 12
#define NONE 2.0
#define SLACK 1e-9
#define ROWS 48
enum { READY, SETTLE, LAND };

/* Tables of the three mode sets; E is [mode][level][N][N], `levels` long. */
typedef struct {
    const double *E, *A, *G, *GA, *B, *BA, *landing, *slip, *need, *load, *bernstein;
    const int64_t *count, *depth, *order;
    int64_t levels;
    double mu_static, step;
} Rig;

static double value(const double *c, int low, int degree, double u) {
    double p = c[degree];
    for (int k = degree - 1; k >= low; k--) p = p * u + c[k];
    return p;
}

static double slope(const double *c, int low, int degree, double u) {
    double p = 0.0;
    for (int k = degree; k > low; k--) p = p * u + (k - low) * c[k];
    return p;
}

static double polish(const double *c, int low, int degree, double a, double b) {
    double u = 0.5 * (a + b);
    for (int i = 0; i < 80; i++) {
        double p = value(c, low, degree, u);
        if (p > 0.0) a = u;
        else b = u;
        double d = slope(c, low, degree, u), next = d != 0.0 ? u - p / d : 2.0;
        if (fabs(next - u) <= 4e-16 || b - a <= 4e-16) return u;
        u = a < next && next < b ? next : 0.5 * (a + b);
    }
    return u;
}

static double first_fall(const double *bernstein, const double *c, int degree, double zero) {
    static double work[ROWS][DEGREE + 3];
    int low = 0;
    if (fabs(c[0]) <= zero) {
        double size = 0.0;
        for (int k = 1; k <= degree; k++) size += fabs(c[k]);
        if (size <= zero) return NONE;
        low = 1;
        while (low < 3 && low < degree && fabs(c[low]) <= fmax(1e-13 * size, zero)) low++;
        if (c[low] < 0.0) return 0.0;
    } else if (c[0] < 0.0) return 0.0;
    double lowest = c[low];
    for (int k = low + 1; k <= degree; k++) lowest += fmin(c[k], 0.0);
    if (lowest > 0.0) return NONE;
    int d = degree - low, top = 1;
    const double *to = bernstein + d * (DEGREE + 1) * (DEGREE + 1);
    for (int i = 0; i <= d; i++) {
        double s = 0.0;
        for (int k = 0; k <= i; k++) s += to[i * (DEGREE + 1) + k] * c[low + k];
        work[0][i] = s;
    }
    work[0][DEGREE + 1] = 0.0;
    work[0][DEGREE + 2] = 1.0;
    while (top > 0) {
        double *row = work[--top];
        int changes = 0, above = 1, touches = 0;
        for (int i = 0; i <= d; i++) {
            if (row[i] <= 0.0) touches = 1;
            if ((row[i] > 0.0) != above) changes++, above = !above;
        }
        if (!touches) continue;
        double at = row[DEGREE + 1], width = row[DEGREE + 2];
        if (row[0] <= 0.0) return at;
        if (changes == 1) return polish(c, low, degree, at, at + width);
        if (width < 1e-10 || top + 2 >= ROWS) return at + 0.5 * width;
        double *left = work[top + 1];
        left[0] = row[0];
        for (int level = 0; level < d; level++) {
            for (int i = 0; i < d - level; i++) row[i] = 0.5 * (row[i] + row[i + 1]);
            left[level + 1] = row[0];
        }
        row[DEGREE + 1] = at + 0.5 * width;
        left[DEGREE + 1] = at;
        row[DEGREE + 2] = left[DEGREE + 2] = 0.5 * width;
        top += 2;
    }
    return NONE;
}

static int certified(const Rig *r, int mode, const double *x, const double *y, double shrink) {
    for (int k = 0; k < r->count[mode]; k++) {
        int at = (mode * 2 + k) * N;
        const double *G = r->G + at, *GA = r->GA + at;
        double before = dot(G, x), after = dot(G, y), bound = 0.0, slow = 0.0;
        for (int j = 0; j < N; j++) {
            bound += r->B[at + j] * fabs(x[j]);
            slow += r->BA[at + j] * fabs(x[j]);
        }
        if (before > bound * shrink && after > bound * shrink) continue;
        int rising = dot(GA, x) > slow * shrink && dot(GA, y) > slow * shrink;
        if (rising && before >= -rounding(G, x)) continue;
        int falling = dot(GA, x) < -slow * shrink && dot(GA, y) < -slow * shrink;
        if (!(falling && after > 0.0)) return 0;
    }
    return 1;
}

static void along(double d[DEGREE + 1][N], int terms, double u, double *x) {
    for (int i = 0; i < N; i++) {
        double s = d[terms][i];
        for (int k = terms - 1; k >= 0; k--) s = s * u + d[k][i];
        x[i] = s;
    }
}

/* The rest of one tick from place *u in it: the guard that fell, or -1 at its end. */
static int opened(const Rig *r, int mode, double *x, const double *size, double *u) {
    static double d[DEGREE + 1][N];
    int depth = (int)r->depth[mode], terms = (int)r->order[mode];
    double cells = ldexp(1.0, depth), y[N], poly[DEGREE + 1];
    while (*u < 1.0) {
        double position = *u * cells;
        int64_t whole = (int64_t)position;
        int level = depth;
        if (position == whole) {
            while (level > 0 && whole % 2 == 0 && *u + 2.0 / ldexp(1.0, level) <= 1.0) whole /= 2, level--;
            int found = 0;
            for (;; level++) {
                const double *E = r->E + (mode * r->levels + level) * N * N;
                for (int i = 0; i < N; i++) y[i] = x[i] + dot(E + i * N, x);
                if ((found = certified(r, mode, x, y, 1.0 / ldexp(1.0, 2 * level))) || level == depth) break;
            }
            if (found) {
                memcpy(x, y, sizeof(y));
                *u += 1.0 / ldexp(1.0, level);
                continue;
            }
        }
        double length = ((int64_t)position + 1) / cells - *u;
        memcpy(d[0], x, sizeof(y));
        for (int k = 1; k <= terms; k++)
            for (int i = 0; i < N; i++) d[k][i] = length * r->step / k * dot(r->A + (mode * N + i) * N, d[k - 1]);
        double first = NONE;
        int guard = -1;
        for (int k = 0; k < r->count[mode]; k++) {
            const double *G = r->G + (mode * 2 + k) * N;
            for (int q = 0; q <= terms; q++) poly[q] = dot(G, d[q]);
            double fall = first_fall(r->bernstein, poly, terms, rounding(G, size));
            if (fall < first) first = fall, guard = k;
        }
        double reach = guard < 0 ? 1.0 : first;
        if (reach > 0.0) along(d, terms, reach, x);
        *u = guard >= 0 ? *u + reach * length : ((int64_t)position + 1) / cells;
        if (guard >= 0) return guard;
    }
    *u = 0.0;
    return -1;
}

static int settle(const Rig *r, int mode, int pending, double *x, double *size, double slack) {
    for (int i = 0; i < N; i++) size[i] = fmax(size[i], fabs(x[i]));
    for (int round = 0; round < 20; round++) {
        if (pending == LAND && mode == 2) {
            double copy[N];
            memcpy(copy, x, sizeof(copy));
            for (int i = 0; i < N; i++) x[i] = dot(r->landing + i * N, copy);
        }
        pending = SETTLE;
        double w = dot(r->slip, x), noise = rounding(r->slip, size);
        int next = mode;
        if (mode == 2) {
            double wanted = dot(r->need, x), limit = r->mu_static * dot(r->load, x);
            if (fabs(w) > noise) next = w > 0.0 ? 0 : 1;
            else if (fabs(wanted) > limit * (1.0 + slack)) next = wanted > 0.0 ? 0 : 1;
        } else if ((mode == 0 ? w : -w) < -noise) next = w > 0.0 ? 0 : 1;
        if (next == mode) return mode;
        mode = next;
    }
    return -1;
}

int64_t exact_run(const Rig *r, int64_t ticks, int mode, double *x, double *size, double *out, int64_t *event_tick,
                  double *event_place) {
    double u = 0.0, g[2];
    int64_t tick = 0, events = 0;
    int pending = SETTLE, repeat = 0;
    while (tick < ticks) {
        if (pending != READY) mode = settle(r, mode, pending, x, size, repeat > 1 ? SLACK : 0.0), pending = READY;
        const double *G = r->G + mode * 2 * N;
        if (u == 0.0) {
            for (int k = 0; k < r->count[mode]; k++) g[k] = dot(G + k * N, x);
            tick += quiet(r->E + mode * r->levels * N * N, G, r->B + mode * 2 * N, r->count[mode], x, g, ticks - tick,
                          out + tick * N);
            if (tick == ticks) break;
        }
        int guard = opened(r, mode, x, size, &u);
        if (guard < 0) {
            memcpy(out + tick++ * N, x, N * sizeof(double));
            continue;
        }
        int same = events > 0 && event_tick[events - 1] == tick && fabs(event_place[events - 1] - u) < 1e-12;
        repeat = same ? repeat + 1 : 0;
        event_tick[events] = tick;
        event_place[events++] = u;
        mode = mode == 2 ? guard : 2;
        pending = LAND;
    }
    return events;
}
