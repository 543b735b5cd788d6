//! The interface of all drivers, and setting up an instrument through it.

use super::decoded::Decoded;
use super::diagnosis;
use super::setup::Setup;
use crate::error::HwError;
use crate::transport::{Endpoint, Link};

/// Host side of one protocol.
///
/// A [`Session`](super::Session) calls it, and calls [`connect`](Self::connect) and
/// [`start`](Self::start) again after the instrument was lost.
pub trait Driver: Send {
    /// Returns the driver's name in the scene file.
    fn name(&self) -> &'static str;

    /// Stops an old stream, identifies the instrument, configures it and reads back what it can.
    ///
    /// # Errors
    /// [`HwError::NoReply`], [`HwError::Refused`], [`HwError::ReadBack`] or [`HwError::Lost`].
    fn connect(&mut self, link: &mut Link) -> Result<Setup, HwError>;

    /// Starts the stream of frames.
    ///
    /// # Errors
    /// Those of [`connect`](Self::connect).
    fn start(&mut self, link: &mut Link) -> Result<(), HwError>;

    /// Decodes bytes of the running stream and calls `on_decoded` for each result. No bytes: nothing arrived for a while.
    fn receive(&mut self, bytes: &[u8], on_decoded: &mut dyn FnMut(Decoded<'_>));

    /// Called at least every 20 ms while the stream runs, to poll instruments that send each frame
    /// on request.
    ///
    /// # Errors
    /// [`HwError::Lost`] if the connection is lost.
    fn idle(&mut self, link: &mut Link) -> Result<(), HwError> {
        let _ = link;
        Ok(())
    }

    /// Stops the stream without waiting for an answer.
    ///
    /// # Errors
    /// [`HwError::Lost`] if the connection is lost.
    fn stop(&mut self, link: &mut Link) -> Result<(), HwError>;
}

/// Opens an instrument, identifies and configures it, and closes it again.
///
/// # Errors
/// Any [`HwError`] of the connection or the set-up.
pub fn identify(driver: &mut dyn Driver, endpoint: &Endpoint) -> Result<Setup, HwError> {
    connect(driver, &mut Link::open(endpoint)?)
}

/// Calls [`Driver::connect`]; if no answer came, the error says what was received instead.
pub(super) fn connect(driver: &mut dyn Driver, link: &mut Link) -> Result<Setup, HwError> {
    link.record_input();
    let setup = driver.connect(link).map_err(|error| diagnosis::explain(error, link));
    link.recorded_input();
    setup
}
