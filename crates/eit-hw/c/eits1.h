/* EITS-1 for firmware: one header, C99, no dynamic memory. The specification is docs/EITS-1.md.
 *
 * Licence: MIT OR Apache-2.0, like the project.
 *
 * One frame of 208 real values:
 *
 *     static uint8_t wire[EITS1_WIRE_BYTES(208u * 4u)];
 *     size_t n = eits1_frame(wire, sizeof wire, sequence++, micros(), EITS1_CALIBRATED,
 *                            values, 208, NULL);
 *     if (n != 0) uart_write(wire, n);
 */
#ifndef EITS1_H
#define EITS1_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { EITS1_VERSION = 1, EITS1_HEADER_BYTES = 20, EITS1_MAX_MESSAGE_BYTES = 16384 };

/* kind of a message */
enum {
    EITS1_INFORMATION = 0x01,
    EITS1_CONFIGURATION = 0x02,
    EITS1_ACKNOWLEDGEMENT = 0x03,
    EITS1_REFUSAL = 0x04,
    EITS1_FRAME = 0x10,
    EITS1_TEXT = 0x20,
    EITS1_IDENTIFY = 0x40,
    EITS1_READ_CONFIGURATION = 0x41,
    EITS1_START = 0x42,
    EITS1_STOP = 0x43
};

/* reason for refusing a command */
enum {
    EITS1_REFUSE_UNKNOWN = 1,
    EITS1_REFUSE_LENGTH = 2,
    EITS1_REFUSE_VALUE = 3,
    EITS1_REFUSE_BUSY = 4,
    EITS1_REFUSE_HARDWARE = 5
};

/* flags of a frame */
enum {
    EITS1_SATURATED = 1,
    EITS1_ELECTRODE_OFF = 2,
    EITS1_DROPPED_BEFORE = 4,
    EITS1_CALIBRATED = 8,
    EITS1_COMPLEX = 16,
    EITS1_VALUE_FLAGS = 32
};

/* flags of one measurement */
enum {
    EITS1_Q_SATURATED = 1,
    EITS1_Q_STUCK = 2,
    EITS1_Q_OPEN = 4,
    EITS1_Q_OVER_RANGE = 8,
    EITS1_Q_NON_FINITE = 16,
    EITS1_Q_MISSING = 32
};

/* size of the buffer for a message with this payload: header, CRC, COBS overhead, final 0 */
#define EITS1_WIRE_BYTES(payload) \
    ((payload) + 24u + ((payload) + 24u) / 254u + 2u)

/* Writes one message byte by byte: CRC-32C and COBS need no second buffer. */
typedef struct {
    uint8_t *out;
    size_t room;
    size_t at;    /* bytes written */
    size_t head;  /* position of the open COBS length */
    uint32_t crc; /* of the bytes before COBS, inverted */
    int full;     /* the buffer was too small */
} eits1_writer;

static inline void eits1_raw(eits1_writer *w, uint8_t byte) {
    if (w->at < w->room) {
        w->out[w->at++] = byte;
    } else {
        w->full = 1;
    }
}

static inline void eits1_stuff(eits1_writer *w, uint8_t byte) {
    if (w->full || w->head >= w->room) {
        w->full = 1;
        return;
    }
    if (w->out[w->head] == 0xFF) {
        w->head = w->at;
        eits1_raw(w, 1);
        if (w->full) return;
    }
    if (byte == 0) {
        w->head = w->at;
        eits1_raw(w, 1);
    } else {
        eits1_raw(w, byte);
        if (!w->full) w->out[w->head]++;
    }
}

/* Writes one byte of header or payload; the CRC table covers half a byte (Castagnoli, reflected). */
static inline void eits1_put(eits1_writer *w, uint8_t byte) {
    static const uint32_t table[16] = {
        0x00000000u, 0x105EC76Fu, 0x20BD8EDEu, 0x30E349B1u, 0x417B1DBCu, 0x5125DAD3u,
        0x61C69362u, 0x7198540Du, 0x82F63B78u, 0x92A8FC17u, 0xA24BB5A6u, 0xB21572C9u,
        0xC38D26C4u, 0xD3D3E1ABu, 0xE330A81Au, 0xF36E6F75u};
    w->crc = (w->crc >> 4) ^ table[(w->crc ^ byte) & 15u];
    w->crc = (w->crc >> 4) ^ table[(w->crc ^ ((uint32_t)byte >> 4)) & 15u];
    eits1_stuff(w, byte);
}

static inline void eits1_put_u16(eits1_writer *w, uint16_t v) {
    eits1_put(w, (uint8_t)(v & 0xFFu));
    eits1_put(w, (uint8_t)(v >> 8));
}

static inline void eits1_put_u32(eits1_writer *w, uint32_t v) {
    eits1_put_u16(w, (uint16_t)(v & 0xFFFFu));
    eits1_put_u16(w, (uint16_t)(v >> 16));
}

static inline void eits1_put_f32(eits1_writer *w, float v) {
    uint32_t bits;
    memcpy(&bits, &v, sizeof bits);
    eits1_put_u32(w, bits);
}

/* Starts a message by writing its header. `count` is the number of floats in a frame, otherwise of
 * payload bytes. */
static inline void eits1_begin(eits1_writer *w, uint8_t *out, size_t room, uint8_t kind,
                               uint32_t sequence, uint64_t time_us, uint16_t flags,
                               uint16_t count) {
    w->out = out;
    w->room = room;
    w->at = 0;
    w->head = 0;
    w->crc = 0xFFFFFFFFu;
    w->full = 0;
    eits1_raw(w, 1);
    eits1_put(w, EITS1_VERSION);
    eits1_put(w, kind);
    eits1_put_u16(w, 0);
    eits1_put_u32(w, sequence);
    eits1_put_u32(w, (uint32_t)(time_us & 0xFFFFFFFFu));
    eits1_put_u32(w, (uint32_t)(time_us >> 32));
    eits1_put_u16(w, flags);
    eits1_put_u16(w, count);
}

/* Ends a message with CRC and 0. Returns the number of bytes to send, 0 if the buffer was too small. */
static inline size_t eits1_end(eits1_writer *w) {
    uint32_t crc = w->crc ^ 0xFFFFFFFFu;
    int i;
    for (i = 0; i < 4; i++) eits1_stuff(w, (uint8_t)((crc >> (8 * i)) & 0xFFu));
    eits1_raw(w, 0);
    return w->full ? 0 : w->at;
}

/* Writes a message of bytes: information, configuration, acknowledgement, refusal or text. Returns
 * the number of bytes to send, 0 if the buffer is too small or the message too long. */
static inline size_t eits1_message(uint8_t *out, size_t room, uint8_t kind, uint32_t sequence,
                                   const uint8_t *payload, uint16_t length) {
    eits1_writer w;
    uint16_t i;
    if ((size_t)length + 24u > EITS1_MAX_MESSAGE_BYTES) return 0;
    eits1_begin(&w, out, room, kind, sequence, 0, 0, length);
    for (i = 0; i < length; i++) eits1_put(&w, payload[i]);
    return eits1_end(&w);
}

/* Writes a frame of `count` floats (two per complex value, with EITS1_COMPLEX in `flags`). `quality`
 * is one byte of EITS1_Q_... flags per measurement, or NULL. Returns the number of bytes to send, 0
 * if the buffer is too small, the message too long, or `count` odd for complex values. */
static inline size_t eits1_frame(uint8_t *out, size_t room, uint32_t sequence, uint64_t time_us,
                                 uint16_t flags, const float *values, uint16_t count,
                                 const uint8_t *quality) {
    eits1_writer w;
    size_t i, measurements = (flags & EITS1_COMPLEX) ? count / 2u : count;
    size_t bytes = (size_t)count * 4u + (quality ? measurements : 0u) + 24u;
    if (((flags & EITS1_COMPLEX) && count % 2u != 0) || bytes > EITS1_MAX_MESSAGE_BYTES) return 0;
    flags = (uint16_t)(quality ? (flags | EITS1_VALUE_FLAGS) : (flags & ~(unsigned)EITS1_VALUE_FLAGS));
    eits1_begin(&w, out, room, EITS1_FRAME, sequence, time_us, flags, count);
    for (i = 0; i < count; i++) eits1_put_f32(&w, values[i]);
    if (quality) {
        for (i = 0; i < measurements; i++) eits1_put(&w, quality[i]);
    }
    return eits1_end(&w);
}

#ifdef __cplusplus
}
#endif

#endif
