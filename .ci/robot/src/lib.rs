//! Modules shared by the robot's programs.
pub mod emulated;
pub mod robot_loop;
