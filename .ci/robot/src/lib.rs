//! What the robot's programs share.
pub mod emulated;
pub mod robot_loop;
