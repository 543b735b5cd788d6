//! The sinks of a publisher, and the images they show.

use super::Publisher;
use crate::error::PublishError;
use crate::image::SkinImage;
use crate::lines::LineSink;
#[cfg(any(feature = "foxglove", feature = "zenoh"))]
use crate::outbox::worker::QueuedSink;
use crate::shape::SkinShape;
use crate::udp::UdpSink;
use std::io::Write;

impl Publisher {
    /// Sets the writer of lines, replacing an earlier one. They are written in a thread of their own: beyond four seconds, a
    /// slow reader costs the oldest frames of a live skin, which an event `skipped` counts; frames of a recording
    /// ([`Start::is_live`](super::Start::is_live)) wait for it.
    ///
    /// # Errors
    ///
    /// No thread.
    pub fn with_lines(mut self, out: impl Write + Send + 'static) -> Result<Self, PublishError> {
        self.lines = Some(LineSink::new(Box::new(out), false)?);
        Ok(self)
    }

    /// Like [`Publisher::with_lines`], but a reader that is behind gets the newest frame, and no event for the others.
    ///
    /// # Errors
    ///
    /// No thread.
    pub fn with_latest_lines(
        mut self,
        out: impl Write + Send + 'static,
    ) -> Result<Self, PublishError> {
        self.lines = Some(LineSink::new(Box::new(out), true)?);
        Ok(self)
    }

    /// Adds a destination of datagrams.
    pub fn with_udp(mut self, sink: UdpSink) -> Self {
        self.udp.push(sink);
        self
    }

    /// Adds the page for browsers (feature `web`), which shows at most 30 frames a second.
    #[cfg(feature = "web")]
    pub fn with_web(mut self, server: crate::web::WebServer) -> Self {
        self.web = Some(server);
        self
    }

    /// Adds zenoh (feature `zenoh`).
    #[cfg(feature = "zenoh")]
    pub fn with_zenoh(mut self, sink: crate::ZenohSink) -> Self {
        self.zenoh.push(sink);
        self
    }

    /// Adds Foxglove (feature `foxglove`).
    #[cfg(feature = "foxglove")]
    pub fn with_foxglove(mut self, sink: crate::FoxgloveSink) -> Self {
        self.foxglove = Some(sink);
        self
    }

    /// Whether a sink can show images.
    pub fn takes_images(&self) -> bool {
        #[cfg(feature = "web")]
        if self.web.is_some() {
            return true;
        }
        #[cfg(any(feature = "foxglove", feature = "zenoh"))]
        if self.queued().next().is_some() {
            return true;
        }
        false
    }

    /// Returns whether images are needed now: by a browser, a subscriber of the image topic, Foxglove or its
    /// recording.
    pub fn has_viewer(&self) -> bool {
        #[cfg(feature = "web")]
        if self.web.as_ref().is_some_and(crate::web::WebServer::has_browser) {
            return true;
        }
        #[cfg(any(feature = "foxglove", feature = "zenoh"))]
        if self.queued().any(QueuedSink::has_viewer) {
            return true;
        }
        false
    }

    /// Passes the shape to sinks that draw the skin.
    ///
    /// # Errors
    ///
    /// A shape that cannot be encoded.
    #[cfg_attr(
        not(any(feature = "web", feature = "foxglove", feature = "zenoh")),
        allow(unused_variables, clippy::unused_self, reason = "no sink here draws")
    )]
    pub fn skin(&self, shape: &SkinShape) -> Result<(), PublishError> {
        #[cfg(any(feature = "foxglove", feature = "zenoh"))]
        self.queued().for_each(|sink| sink.skin(shape));
        #[cfg(feature = "web")]
        if let Some(web) = &self.web {
            web.skin(shape)?;
        }
        Ok(())
    }

    /// Whether a sink needs a new image: it has viewers, and its last image is old enough.
    #[cfg_attr(
        not(any(feature = "web", feature = "foxglove", feature = "zenoh")),
        allow(clippy::unused_self, reason = "no sink here takes images")
    )]
    pub fn wants_image(&mut self) -> bool {
        #[allow(unused_mut, reason = "not without features")]
        let mut wanted = false;
        #[cfg(feature = "web")]
        if let Some(web) = &mut self.web {
            wanted |= web.wants_image();
        }
        #[cfg(any(feature = "foxglove", feature = "zenoh"))]
        self.queued_mut().for_each(|sink| wanted |= sink.is_image_due());
        wanted
    }

    /// Returns what the page has requested since the last call: true to start a recording, false to stop it
    /// (feature `web`; only with [`WebServer::with_recording`](crate::WebServer::with_recording)).
    #[cfg(feature = "web")]
    pub fn recording_request(&self) -> Option<bool> {
        self.web.as_ref()?.recording_request()
    }

    /// Passes the state of the recording to the page (feature `web`).
    ///
    /// # Errors
    ///
    /// A state that cannot be encoded.
    #[cfg(feature = "web")]
    pub fn recording(&self, recording: crate::web::Recording<'_>) -> Result<(), PublishError> {
        self.web.as_ref().map_or(Ok(()), |web| web.recording(recording))
    }

    /// Publishes an image; the page also shows the image before the net, and the certified gap.
    ///
    /// # Errors
    ///
    /// An image that cannot be encoded.
    #[cfg_attr(
        not(any(feature = "web", feature = "foxglove", feature = "zenoh")),
        allow(unused_variables, clippy::unused_self, reason = "no sink here takes images")
    )]
    pub fn image<'a>(&self, image: impl Into<SkinImage<'a>>) -> Result<(), PublishError> {
        let image = image.into();
        #[cfg(any(feature = "foxglove", feature = "zenoh"))]
        self.queued().for_each(|sink| sink.worker().outbox.image(image.change_s, image.faintest_s));
        #[cfg(feature = "web")]
        if let Some(web) = &self.web {
            web.tell(&serde_json::to_vec(&crate::web::ImageEvent::new(&image))?);
        }
        Ok(())
    }

    /// The UDP sinks with their counts.
    pub fn udp(&self) -> &[UdpSink] {
        &self.udp
    }

    /// Returns the zenoh sinks, with their counts (feature `zenoh`).
    #[cfg(feature = "zenoh")]
    pub fn zenoh(&self) -> &[crate::ZenohSink] {
        &self.zenoh
    }

    /// Returns the Foxglove sink, with its counts (feature `foxglove`).
    #[cfg(feature = "foxglove")]
    pub fn foxglove(&self) -> Option<&crate::FoxgloveSink> {
        self.foxglove.as_ref()
    }

    /// Iterates over the sinks that have a queue.
    #[cfg(any(feature = "foxglove", feature = "zenoh"))]
    pub(super) fn queued(&self) -> impl Iterator<Item = &dyn QueuedSink> {
        let sinks = std::iter::empty::<&dyn QueuedSink>();
        #[cfg(feature = "zenoh")]
        let sinks = sinks.chain(self.zenoh.iter().map(|sink| sink as &dyn QueuedSink));
        #[cfg(feature = "foxglove")]
        let sinks = sinks.chain(self.foxglove.iter().map(|sink| sink as &dyn QueuedSink));
        sinks
    }

    #[cfg(any(feature = "foxglove", feature = "zenoh"))]
    pub(super) fn queued_mut(&mut self) -> impl Iterator<Item = &mut dyn QueuedSink> {
        let sinks = std::iter::empty::<&mut dyn QueuedSink>();
        #[cfg(feature = "zenoh")]
        let sinks = sinks.chain(self.zenoh.iter_mut().map(|sink| sink as &mut dyn QueuedSink));
        #[cfg(feature = "foxglove")]
        let sinks = sinks.chain(self.foxglove.iter_mut().map(|sink| sink as &mut dyn QueuedSink));
        sinks
    }
}
