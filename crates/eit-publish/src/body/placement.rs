//! Where a patch is on the robot.

use crate::ros::{Point, Pose, Quaternion, TouchMessage};

/// Pose of a patch in the robot's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// Origin of the patch, metres.
    pub position_m: [f64; 3],
    /// Rotation from patch to robot coordinates, by rows.
    pub rotation: [[f64; 3]; 3],
    quaternion: [f64; 4],
}

impl Default for Placement {
    /// The patch's frame is the robot's.
    fn default() -> Self {
        Self::new([0.0; 3], [0.0, 0.0, 0.0, 1.0])
    }
}

impl Placement {
    /// Creates a pose from an origin, metres, and a quaternion `[x, y, z, w]`, which need not be
    /// normalised but must not be zero.
    pub fn new(position_m: [f64; 3], quaternion: [f64; 4]) -> Self {
        let length = quaternion.iter().map(|part| part * part).sum::<f64>().sqrt();
        let quaternion = quaternion.map(|part| part / length);
        let [x, y, z, w] = quaternion;
        let rotation = [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
        ];
        Self { position_m, rotation, quaternion }
    }

    /// Creates a pose from an origin, metres, and angles, radians, about the fixed axes x, y and z, applied in
    /// this order, as in URDF (`rpy`).
    pub fn from_angles(position_m: [f64; 3], roll_pitch_yaw: [f64; 3]) -> Self {
        let [r, p, y] = roll_pitch_yaw.map(|angle| (angle / 2.0).sin_cos());
        let quaternion = [
            r.0 * p.1 * y.1 - r.1 * p.0 * y.0,
            r.1 * p.0 * y.1 + r.0 * p.1 * y.0,
            r.1 * p.1 * y.0 - r.0 * p.0 * y.1,
            r.1 * p.1 * y.1 + r.0 * p.0 * y.0,
        ];
        Self::new(position_m, quaternion)
    }

    /// The same as a message.
    pub fn pose(&self) -> Pose {
        let [x, y, z, w] = self.quaternion;
        Pose { position: Point::from(self.position_m), orientation: Quaternion { x, y, z, w } }
    }

    fn rotate(&self, vector: [f64; 3]) -> [f64; 3] {
        self.rotation.map(|row| (0..3).map(|axis| row[axis] * vector[axis]).sum())
    }

    /// Transforms a touch to robot coordinates: position, its covariance, normal and velocity.
    pub fn place(&self, touch: &TouchMessage) -> TouchMessage {
        let mut position = self.rotate(touch.position.into());
        for (coordinate, origin) in position.iter_mut().zip(self.position_m) {
            *coordinate += origin;
        }
        // R C R^T
        let rotation = &self.rotation;
        let covariance = |row: usize, column: usize| -> f64 {
            let terms = (0..9).map(|index| {
                let (i, j) = (index / 3, index % 3);
                rotation[row][i] * touch.position_covariance[index] * rotation[column][j]
            });
            terms.sum()
        };
        TouchMessage {
            position: position.into(),
            position_covariance: std::array::from_fn(|index| covariance(index / 3, index % 3)),
            normal: self.rotate(touch.normal.into()).into(),
            velocity: self.rotate(touch.velocity.into()).into(),
            ..*touch
        }
    }
}
