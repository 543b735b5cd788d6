//! Runs a control loop on live touches: `robot_loop [PORT]`; without a port, an emulated skin is touched.
use eit_skin::Skin;
use robot::{emulated, robot_loop};
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let skin = Skin::load(concat!(env!("CARGO_MANIFEST_DIR"), "/skin.toml"))?;
    let port = std::env::args().nth(1);
    let emulated = port.is_none().then(|| emulated::start(&skin)).transpose()?;
    let port = port.or(emulated.as_ref().map(|emulated| emulated.endpoint().to_string()));
    let (mut ticks, mut touched) = (0..800, 0);
    let late = robot_loop::run(&skin, port.as_deref(), |touches| {
        // here a robot would draw back, or grasp harder; without a sensor it would slow down
        touched += usize::from(touches.is_some_and(|touches| !touches.is_empty()));
        ticks.next().is_some()
    })?;
    println!("{touched} ticks with a touch, {late} late");
    Ok(())
}
