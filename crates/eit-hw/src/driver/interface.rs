//! What every driver does, and the set-up of an instrument by it.

use super::decoded::Decoded;
use super::diagnosis;
use super::setup::Setup;
use crate::error::HwError;
use crate::transport::{Endpoint, Link};

/// One protocol from the host's side. A [`Session`](super::Session) calls it; both [`connect`](Self::connect) and
/// [`start`](Self::start) are called again after the instrument was lost.
pub trait Driver: Send {
    /// Name in the scene file.
    fn name(&self) -> &'static str;

    /// Stops an old stream, identifies the instrument, sets it up and reads back what it can.
    ///
    /// # Errors
    /// [`HwError::NoReply`], [`HwError::Refused`], [`HwError::ReadBack`], [`HwError::Lost`].
    fn connect(&mut self, link: &mut Link) -> Result<Setup, HwError>;

    /// Starts the frames.
    ///
    /// # Errors
    /// As [`connect`](Self::connect).
    fn start(&mut self, link: &mut Link) -> Result<(), HwError>;

    /// Takes bytes of the running stream.
    fn receive(&mut self, bytes: &[u8], on_decoded: &mut dyn FnMut(Decoded<'_>));

    /// Called at least every 20 ms while the stream runs, for instruments that are asked for each
    /// frame.
    ///
    /// # Errors
    /// [`HwError::Lost`].
    fn idle(&mut self, link: &mut Link) -> Result<(), HwError> {
        let _ = link;
        Ok(())
    }

    /// Stops the frames; no answer is waited for.
    ///
    /// # Errors
    /// [`HwError::Lost`].
    fn stop(&mut self, link: &mut Link) -> Result<(), HwError>;
}

/// Opens an instrument, asks who it is, sets it up, and closes it again.
///
/// # Errors
/// [`HwError`] of the connection or the set-up.
pub fn identify(driver: &mut dyn Driver, endpoint: &Endpoint) -> Result<Setup, HwError> {
    connect(driver, &mut Link::open(endpoint)?)
}

/// [`Driver::connect`], with an error that says what came instead of an answer.
pub(super) fn connect(driver: &mut dyn Driver, link: &mut Link) -> Result<Setup, HwError> {
    link.record_input();
    let setup = driver.connect(link).map_err(|error| diagnosis::explain(error, link));
    link.recorded_input();
    setup
}
