// Touches on a robot skin by electrical impedance tomography, for C and C++.
//
// Link with libeit_skin_c (cargo build --release --manifest-path crates/eit-c/Cargo.toml).
// Load a scene, push frames, read touches, free. Nothing here calls back, blocks or starts a thread. A sensor is used by
// one thread at a time; several sensors are independent. All units are SI. This file is made by cbindgen.

#ifndef EIT_SKIN_H
#define EIT_SKIN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

// What a frame led to.
typedef enum {
  // The frame was refused or failed: see `eit_message`. The touches are those of the frame before.
  EIT_PUSH_ERROR = -1,
  // The frame went into the reference, for which the skin must be untouched. There are no touches yet.
  EIT_PUSH_REFERENCE = 0,
  // The touches of the frame were found.
  EIT_PUSH_TOUCHES = 1,
} EitPush;

// Whether a touch is new.
typedef enum {
  // Reported for the first time.
  EIT_TOUCH_STATE_BEGIN = 0,
  // Reported before.
  EIT_TOUCH_STATE_HOLD = 1,
  // Reported for the last time; where it was seen last.
  EIT_TOUCH_STATE_END = 2,
} EitTouchState;

// What is known of the skin.
typedef enum {
  // Touches, or their absence, explain the frame.
  EIT_SKIN_STATE_SOUND = 0,
  // They do not: no touch is valid.
  EIT_SKIN_STATE_NOT_EXPLAINED = 1,
  // The instrument repeats an old frame.
  EIT_SKIN_STATE_FROZEN = 2,
  // The reference is being taken.
  EIT_SKIN_STATE_REFERENCE = 3,
  // There are no data.
  EIT_SKIN_STATE_NO_DATA = 4,
} EitSkinState;

// A skin that frames are pushed to.
typedef struct EitSensor EitSensor;

// A touch. What is unknown is NaN.
typedef struct {
  // Counted from 1 and never reused.
  uint64_t id;
  // New, held or ended.
  EitTouchState state;
  // Whether position and strength may be acted on.
  bool valid;
  // Whether the frame was complete, without faulty electrodes.
  bool whole;
  // Position x, y, z, metres.
  double position_m[3];
  // Standard deviation of each coordinate, metres.
  double position_std_m[3];
  // Velocity, metres per second.
  double velocity_m_s[3];
  // Force and its standard deviation, newton, where they were learnt.
  double force_n;
  // Standard deviation of the force, newton.
  double force_std_n;
  // Integral of the conductivity change, S m^2.
  double intensity_s_m2;
  // Confidence that there is a touch, 0 to 1.
  double confidence;
  // Time since its begin, seconds.
  double age_s;
} EitTouch;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// Loads a scene file, or a built-in scene by name, such as "paper-disc". Takes up to a second. Returns NULL after an error,
// whose message, cut to `size` bytes with its ending zero, is in `message` unless that is NULL.
//
// # Safety
// `scene` is a string that ends with a zero; `message` is NULL or has room for `size` bytes.
EitSensor *eit_load(const char *scene,
                    char *message,
                    size_t size);

// Number of values of a frame; 0 for NULL.
//
// # Safety
// `sensor` is NULL or from `eit_load` and not freed.
size_t eit_measurements(const EitSensor *sensor);

// Number of frames of the untouched skin that the reference needs; 0 for NULL.
//
// # Safety
// `sensor` is NULL or from `eit_load` and not freed.
size_t eit_reference_frames(const EitSensor *sensor);

// Takes a frame: `count` values in protocol order, volt, NaN where one was lost, and the instrument's time in seconds, or NaN.
//
// # Safety
// `sensor` is NULL or from `eit_load` and not freed; `values_v` is NULL or points at `count` values.
EitPush eit_push(EitSensor *sensor,
                 const double *values_v,
                 size_t count,
                 double time_s);

// Writes the touches of the last frame into `touches`, at most `capacity`; returns how many there are.
//
// # Safety
// `sensor` is NULL or from `eit_load` and not freed; `touches` is NULL or has room for `capacity` touches.
size_t eit_touches(const EitSensor *sensor,
                   EitTouch *touches,
                   size_t capacity);

// What the last frame said of the skin; no data for NULL.
//
// # Safety
// `sensor` is NULL or from `eit_load` and not freed.
EitSkinState eit_state(const EitSensor *sensor);

// Message of the last error of `eit_push`, valid until the next; empty if there was none, NULL for NULL.
//
// # Safety
// `sensor` is NULL or from `eit_load` and not freed.
const char *eit_message(const EitSensor *sensor);

// Frees a sensor. NULL is ignored.
//
// # Safety
// `sensor` is NULL or from `eit_load`, and not used any more.
void eit_free(EitSensor *sensor);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* EIT_SKIN_H */
