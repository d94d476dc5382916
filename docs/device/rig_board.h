/* Frames of friction-rig for a board, see docs/device.md. Needs stdint.h and nothing else; no malloc.

   Define INPUTS and OUTPUTS, the numbers of measurements and commands, include this file, and write

       void law_start(void)                                           before the first step and after a reset
       void law(int64_t t_ns, const double *in, double *out)          one step; all values in SI units

   Serial: give each byte that arrives to rig_byte and send rig_out, as many bytes as it returns.
   UDP:    give each datagram to rig_answer and send what it points to, as many bytes as it returns.

   A stream of measured values needs neither INPUTS nor a law: call rig_measured and send rig_out (serial) or rig_last.
   The board is little-endian, as nearly all are. Where double has four bytes (AVR), values = "float32" is needed. */
#ifndef RIG_BOARD_H
#define RIG_BOARD_H
#include <stdint.h>

enum { RIG_VERSION = 0x71, RIG_STEP = 1, RIG_START = 2, RIG_ECHO = 3, RIG_ACT = 0x11, RIG_UNSTARTED = 0x12,
       RIG_ECHOED = 0x13, RIG_MEASURED = 0x14, RIG_HEAD = 16, RIG_MOST = RIG_HEAD + 24 * 8 };

static uint8_t rig_last[RIG_MOST + 4];  /* the last answer or the measured values; room for the CRC */
static uint8_t rig_out[RIG_MOST + 8];   /* what a serial port sends */

static void rig_copy(void *to, const void *from, int n)
{
    uint8_t *a = (uint8_t *)to;
    const uint8_t *b = (const uint8_t *)from;
    while (n--) *a++ = *b++;
}

static uint32_t rig_crc(const uint8_t *p, int n)
{
    uint32_t c = 0xFFFFFFFFu;
    while (n--) {
        c ^= *p++;
        for (int k = 0; k < 8; k++) c = c & 1 ? c >> 1 ^ 0xEDB88320u : c >> 1;
    }
    return ~c;
}

/* Puts a frame of n bytes into rig_out, with CRC, COBS and the zero byte; how many bytes to send. */
static int rig_stuff(uint8_t *frame, int n)
{
    uint32_t crc = rig_crc(frame, n);
    int at = 1, mark = 0;
    rig_copy(frame + n, &crc, 4);
    rig_out[0] = 1;
    for (int i = 0; i < n + 4; i++) {
        if (frame[i]) { rig_out[at++] = frame[i]; rig_out[mark]++; }
        else { mark = at; rig_out[at++] = 1; }
    }
    rig_out[at++] = 0;
    return at;
}

#ifndef INPUTS
/* Makes the frame of n measured values; how many bytes of rig_out to send, 16 + n sizeof(double) of rig_last by UDP. */
static int rig_measured(int64_t t_ns, const double *values, int n)
{
    static uint32_t sequence;
    const uint8_t head[4] = {RIG_VERSION, RIG_MEASURED, (uint8_t)n, sizeof(double)};
    sequence++;
    rig_copy(rig_last, head, 4);
    rig_copy(rig_last + 4, &sequence, 4);
    rig_copy(rig_last + 8, &t_ns, 8);
    rig_copy(rig_last + RIG_HEAD, values, n * (int)sizeof(double));
    return rig_stuff(rig_last, RIG_HEAD + n * (int)sizeof(double));
}
#else
static uint8_t rig_echo[RIG_MOST + 4];
static uint8_t rig_in[RIG_MOST + 8];    /* bytes since the last zero byte */
static int rig_length, rig_count, rig_started;

void law_start(void);
void law(int64_t t_ns, const double *in, double *out);

/* Calls the law for a step and writes the answer; its length. */
static int rig_step(const uint8_t *f, int width)
{
    double in[INPUTS + 1], out[OUTPUTS];
    float small;
    int64_t t_ns;
    if (f[1] == RIG_START) { law_start(); rig_started = 1; }
    rig_copy(rig_last, f, RIG_HEAD);
    rig_last[1] = rig_started ? RIG_ACT : RIG_UNSTARTED;
    rig_last[2] = rig_started ? OUTPUTS : 0;
    if (!rig_started) return RIG_HEAD;
    rig_copy(&t_ns, f + 8, 8);
    for (int i = 0; i < INPUTS; i++) {
        const uint8_t *at = f + RIG_HEAD + i * width;
        if (width == (int)sizeof(double)) rig_copy(in + i, at, width);
        else { rig_copy(&small, at, 4); in[i] = small; }
    }
    law(t_ns, in, out);
    for (int i = 0; i < OUTPUTS; i++) {
        uint8_t *at = rig_last + RIG_HEAD + i * width;
        if (width == (int)sizeof(double)) rig_copy(at, out + i, width);
        else { small = (float)out[i]; rig_copy(at, &small, 4); }
    }
    return RIG_HEAD + OUTPUTS * width;
}

/* The answer to a frame of n bytes: *answer points to it; its length, 0 without one. */
static int rig_answer(const uint8_t *f, int n, uint8_t **answer)
{
    int same = 1;
    int width = n < RIG_HEAD ? 0 : f[3];
    *answer = rig_last;
    if ((width != 4 && width != 8) || n > RIG_MOST || f[0] != RIG_VERSION || n != RIG_HEAD + f[2] * width) return 0;
    if (f[1] == RIG_ECHO) {
        rig_copy(rig_echo, f, n);
        rig_echo[1] = RIG_ECHOED;
        *answer = rig_echo;
        return n;
    }
    if ((f[1] != RIG_STEP && f[1] != RIG_START) || f[2] != INPUTS || (width != 4 && width != (int)sizeof(double))) return 0;
    for (int i = 4; i < RIG_HEAD; i++) same &= rig_last[i] == f[i];
    if (!rig_length || !same) rig_length = rig_step(f, width); /* a repeated frame is answered from memory */
    return rig_length;
}

/* Takes a byte of a serial port; how many bytes of rig_out to send. */
static int rig_byte(uint8_t byte)
{
    uint8_t *answer;
    uint32_t crc;
    int n = 0, at = 0;
    if (byte) { /* too long a frame is damaged: it is counted and not kept */
        if (rig_count < (int)sizeof rig_in) rig_in[rig_count] = byte;
        if (rig_count <= (int)sizeof rig_in) rig_count++;
        return 0;
    }
    if (rig_count > (int)sizeof rig_in) { rig_count = 0; return 0; }
    while (at < rig_count) { /* COBS, in place */
        int code = rig_in[at++];
        if (at + code - 1 > rig_count) { n = 0; break; }
        for (int k = 1; k < code; k++) rig_in[n++] = rig_in[at++];
        if (at < rig_count) rig_in[n++] = 0;
    }
    rig_count = 0;
    if (n < RIG_HEAD + 4) return 0;
    rig_copy(&crc, rig_in + n - 4, 4);
    if (crc != rig_crc(rig_in, n - 4) || (n = rig_answer(rig_in, n - 4, &answer)) == 0) return 0;
    return rig_stuff(answer, n);
}
#endif
#endif
