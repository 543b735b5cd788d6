//! `eit demo`

use super::{network, publish};
use crate::cli::DemoArgs;
use crate::commands::prelude::*;
use eit_hw::driver::{Event, Pace, Replay};
use eit_publish::Publisher;
use eit_report::demo::{self, FrameWatcher, RECORDINGS};
use eit_report::settings::DemoSettings;
use eit_skin::live::{LiveModel, LiveObserver, REFERENCE_FRAMES, Summary, TouchFrame};
use eit_skin::text::printable;
use std::sync::{Mutex, PoisonError};

/// Runs the demo until its end or Ctrl-C; with a page, repeats its experiments until Ctrl-C.
pub(super) fn run(args: &DemoArgs) -> Result<Answer, CliError> {
    let usual = if args.paper { "paper-out" } else { "demo-out" };
    let out = args.out.clone().unwrap_or_else(|| usual.into());
    let settings = DemoSettings { out, force: args.force, quick: args.quick };
    if args.paper {
        let stop = interrupt::listen()?;
        return Ok(demo::paper::run(&settings, &stop, &mut progress::terminal())?);
    }
    let published = open(args)?.map(Mutex::new);
    let stop = interrupt::listen()?;
    let watch = |name: &str, model: &LiveModel, shown: &TouchFrame<'_>| {
        if let Some(published) = &published {
            let mut published = published.lock().unwrap_or_else(PoisonError::into_inner);
            // the demo goes on where publishing failed; the end reports it
            if published.failure.is_none() {
                published.failure = published.publish(name, model, shown).err();
            }
        }
    };
    let watcher = published.is_some().then_some(&watch as &FrameWatcher<'_>);
    let mut answer = demo::run(&settings, watcher, &stop, &mut progress::terminal())?;
    let Some(published) = published else { return Ok(answer) };
    let mut published = published.into_inner().unwrap_or_else(PoisonError::into_inner);
    if args.page.web.is_some() && !stop.is_set() {
        if !terminal::flags().is_json {
            // now, not when the page is closed
            println!("{}", printable(&std::mem::take(&mut answer.text)));
        }
        eprintln!("eit: the page repeats both experiments; Ctrl-C ends it");
        published.repeat(&settings.out)?;
    }
    match published.failure {
        Some(failure) => return Err(failure),
        None => publish::end(published.publisher)?,
    }
    Ok(answer)
}

/// Opens the requested outputs; `None` if there are none.
fn open(args: &DemoArgs) -> Result<Option<Published>, CliError> {
    if args.page.web.is_none() && !network::is_wanted(&args.network) {
        return Ok(None);
    }
    let mut publisher = network::open(&args.network, Publisher::new())?;
    if let Some(address) = &args.page.web {
        publisher = publish::open_page(address, publisher, false)?;
        let words =
            "The fabric and its touches are simulated first: they appear here in some seconds.";
        publisher.event(&Event::Notice(words.to_owned()))?;
    }
    let stop = interrupt::listen()?;
    Ok(Some(Published { publisher, stop, experiments: Vec::new(), count: 0, failure: None }))
}

/// Publishes the experiment that began last, since the experiments may overlap; then the recordings as they are played.
struct Published {
    publisher: Publisher,
    stop: StopFlag,
    /// Names of the experiments so far, while the demo runs.
    experiments: Vec<String>,
    /// Number of experiments shown, repeated ones included.
    count: u32,
    failure: Option<CliError>,
}

impl Published {
    fn publish(
        &mut self,
        name: &str,
        model: &LiveModel,
        shown: &TouchFrame<'_>,
    ) -> Result<(), CliError> {
        if !self.experiments.iter().any(|known| known == name) {
            self.experiments.push(name.to_owned());
            self.begin(name, model)?;
        } else if self.experiments.last().is_none_or(|last| last != name) {
            return Ok(());
        }
        self.frame(shown)
    }

    /// Begins an experiment.
    fn begin(&mut self, name: &str, model: &LiveModel) -> Result<(), CliError> {
        self.count += 1;
        publish::start(&mut self.publisher, model, name, true)
    }

    /// Plays the recordings again and again until Ctrl-C.
    fn repeat(&mut self, folder: &Path) -> Result<(), CliError> {
        let scene = Scene::load(&folder.join("scene.toml").display().to_string())?;
        let model = LiveModel::from_scene(&scene, REFERENCE_FRAMES, &mut progress::terminal())?;
        let model = Arc::new(model);
        let quadruples = model.skin().protocol.quadruples();
        for (name, recording) in RECORDINGS.into_iter().cycle() {
            if self.stop.is_set() {
                break;
            }
            let mut replay = Replay::open(&folder.join(recording), quadruples, Pace::Speed(1.0))?;
            self.begin(name, &model)?;
            model.watch(&mut replay, false, self)?;
        }
        Ok(())
    }
}

impl LiveObserver for Published {
    type Error = CliError;

    fn event(&mut self, event: &Event) -> Result<(), CliError> {
        Ok(self.publisher.event(event)?)
    }

    fn waiting(&mut self, left: usize) -> Result<(), CliError> {
        Ok(self.publisher.waiting(left)?)
    }

    fn frame(&mut self, shown: &TouchFrame<'_>) -> Result<(), CliError> {
        // numbers of touches begin anew
        let frame = TouchFrame { epoch: self.count - 1, ..*shown };
        self.publisher.touches(&frame)?;
        publish::image(&mut self.publisher, shown)
    }

    fn wants_image(&self) -> bool {
        self.publisher.has_viewer()
    }

    fn goes_on(&mut self, _: &Summary) -> bool {
        !self.stop.is_set()
    }
}
