//! Prints the touches of a scene's instrument live:
//! `cargo run --example robot --features hw -- SCENE [PORT]`.
#![allow(clippy::print_stdout, reason = "an example shows its result")]

use eit_skin::{Skin, SkinError};

fn main() -> Result<(), SkinError> {
    let mut arguments = std::env::args().skip(1);
    let scene = arguments.next().unwrap_or_else(|| "skin.toml".to_owned());
    let skin = Skin::load(scene)?;
    let mut sensor = skin.open_at(arguments.next().as_deref())?;
    while let Some(frame) = sensor.next()? {
        for touch in frame.touches {
            println!("{:.2} s: touch {} at {:.3?} m", frame.time_s, touch.id, touch.position_m);
        }
    }
    Ok(())
}
