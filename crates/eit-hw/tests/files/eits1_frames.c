/* Writes frames of 0 to 1024 values, every second one with quality flags, and a text. */
#include "eits1.h"
#include <stdio.h>
int main(void) {
    static uint8_t wire[EITS1_WIRE_BYTES(1024u * 4u + 1024u)];
    static float values[1024];
    static uint8_t quality[1024];
    unsigned count, i;
    size_t n;
    for (count = 0; count <= 1024; count += count < 300 ? 1 : 181) {
        const uint8_t *flags = count % 2 ? quality : NULL;
        uint64_t time = 5000000000ull + count;
        uint16_t sent = (uint16_t)count;
        for (i = 0; i < count; i++) {
            values[i] = i % 5 ? (float)i * 0.37f - 20.0f : 0.0f;
            quality[i] = (uint8_t)(i % 64);
        }
        n = eits1_frame(wire, sizeof wire, count, time, EITS1_CALIBRATED, values, sent, flags);
        /* one byte of room less is too little */
        if (n == 0 || eits1_frame(wire, n - 1, count, time, EITS1_CALIBRATED, values, sent, flags)) return 1;
        eits1_frame(wire, sizeof wire, count, time, EITS1_CALIBRATED, values, sent, flags);
        if (fwrite(wire, 1, n, stdout) != n) return 2;
    }
    if (eits1_frame(wire, sizeof wire, 0, 0, EITS1_COMPLEX, values, 3, NULL) != 0) return 3;
    if (eits1_frame(wire, 0, 0, 0, 0, values, 3, NULL) != 0) return 4;
    n = eits1_message(wire, sizeof wire, EITS1_TEXT, 9, (const uint8_t *)"hello", 5);
    return fwrite(wire, 1, n, stdout) == n ? 0 : 5;
}
