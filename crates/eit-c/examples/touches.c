// Prints the touches of frames on standard input, a line of comma-separated volts each, such as those of
// `eit simulate paper-disc --out frames.csv`; the first 40 are the reference. usage: touches SCENE FRAMES_PER_SECOND < frames.csv
#include "eit_skin.h"
#include <stdio.h>
#include <stdlib.h>

int main(int argc, char **argv) {
    char message[256];
    EitSensor *sensor = eit_load(argc > 1 ? argv[1] : "paper-disc", message, sizeof message);
    if (sensor == NULL) {
        fprintf(stderr, "%s\n", message);
        return 2;
    }
    double rate_hz = argc > 2 ? atof(argv[2]) : 10.0;
    size_t count = eit_measurements(sensor), k = 0, frame = 0;
    double *values_v = malloc(count * sizeof *values_v);
    EitTouch touches[8];
    while (values_v != NULL && scanf("%lf%*[,\n]", &values_v[k]) == 1) {
        if (++k < count) continue;
        k = 0;
        if (eit_push(sensor, values_v, count, (double)frame++ / rate_hz) == EIT_PUSH_ERROR) {
            fprintf(stderr, "frame %zu: %s\n", frame - 1, eit_message(sensor));
            return 1;
        }
        size_t found = eit_touches(sensor, touches, 8);
        for (size_t i = 0; i < found && i < 8; i++)
            printf("frame %zu: touch %llu at %.1f, %.1f mm%s\n", frame - 1, (unsigned long long)touches[i].id,
                   1e3 * touches[i].position_m[0], 1e3 * touches[i].position_m[1],
                   touches[i].state == EIT_TOUCH_STATE_END ? ", ended" : "");
    }
    free(values_v);
    eit_free(sensor);
    return 0;
}
