/* C twins of two kernels of rig.solve, statement for statement: the quiet tick of the exact method, and the whole
   fixed-step run of one oscillator with one friction patch under Coulomb friction (mode sets 0 slip+, 1 slip-, 2 stick).
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
