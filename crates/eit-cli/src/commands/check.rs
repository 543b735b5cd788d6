//! `eit check`: which serial ports there are, which instrument answers, and whether it is ready for use.

use crate::cli::CheckArgs;
use crate::commands::prelude::*;
use eit_hw::driver::{Statistics, identify};
use eit_hw::{
    Finding, HealthReport, ReferenceFrames, Resolution, Verdict, measure_reference_frames,
};
use eit_skin::connect::{self, Backlog};
use eit_skin::health;
use eit_skin::scene::Instrument;

/// Lists the ports, or identifies or checks the scene's instrument.
pub(super) fn run(args: &CheckArgs) -> Result<Ended, CliError> {
    let Some(scene) = &args.scene else { return Ok(ports()?.into()) };
    let least = HealthReport::LEAST_FRAMES;
    let in_range = args.seconds > 0.0 && args.seconds <= 3600.0;
    check_option("--seconds", args.seconds, in_range, "above 0, to 3600")?;
    let wanted = format!("at least {least}, to tell the noise");
    check_option("--frames", args.frames, args.frames >= least, &wanted)?;
    let scene = Scene::load(scene)?;
    let instrument = scene.instrument()?;
    match args.identify {
        true => Ok(identity(&instrument, args.port.as_deref())?.into()),
        false => check(args, &scene, &instrument),
    }
}

/// Lists the serial ports of this computer.
fn ports() -> Result<Answer, CliError> {
    let (mut lines, mut list) = (Vec::new(), Vec::new());
    for port in &eit_hw::serial_ports()? {
        let usb = port.usb.as_ref();
        let name = usb.and_then(|usb| usb.name.as_deref());
        let serial = usb.and_then(|usb| usb.serial.as_deref());
        let ids = usb.map(|usb| format!("{:04x}:{:04x}", usb.vendor, usb.product));
        let words = [Some(port.path.as_str()), ids.as_deref(), name, serial];
        lines.push(words.into_iter().flatten().collect::<Vec<_>>().join("  "));
        list.push(json!({ "port": port.path, "usb": ids, "name": name, "serial": serial }));
    }
    if lines.is_empty() {
        let none =
            "no serial ports: plug the instrument in; for one on a network use tcp:host:port";
        lines.push(none.to_owned());
    }
    Ok(Answer { text: lines.join("\n"), json: json!({ "ports": list }) })
}

/// Asks the instrument what it is.
fn identity(instrument: &Instrument, port: Option<&str>) -> Result<Answer, CliError> {
    let endpoint = instrument.endpoint(port)?;
    let setup = identify(&mut *instrument.driver()?, &endpoint)?;
    let unit = word(setup.unit);
    let rate =
        setup.frame_rate_hz.map_or(String::new(), |rate| format!(", {rate} frames per second"));
    let kind = if setup.complex { "complex" } else { "real" };
    let text = format!(
        "{endpoint}: {} (driver {}), {} {kind} values per frame{rate}, unit {unit}",
        setup.identity, setup.identity.driver, setup.value_count
    );
    let json = json!({
        "port": endpoint.to_string(),
        "driver": setup.identity.driver,
        "instrument": setup.identity.name,
        "serial": setup.identity.serial,
        "values": setup.value_count,
        "complex": setup.complex,
        "unit": unit,
        "frame_rate_hz": setup.frame_rate_hz,
    });
    Ok(Answer { text, json })
}

/// Takes frames of the untouched skin and judges them.
fn check(args: &CheckArgs, scene: &Scene, instrument: &Instrument) -> Result<Ended, CliError> {
    let mut progress = progress::terminal();
    let port = args.port.as_deref();
    let mut session =
        progress.stage("connect", || connect::open(instrument, port, Backlog::Recorded))?;
    let limit = Duration::from_secs_f64(args.seconds);
    let quiet = progress.stage("measure: do not touch the skin", || {
        measure_reference_frames(&mut session, args.frames, limit)
    })?;
    let statistics = session.statistics();
    session.stop();
    let (found, seconds, bytes) = (quiet.frames.values.nrows(), args.seconds, statistics.bytes);
    let name = session.setup().identity.to_string();
    if found == 0 {
        return Err(CliError::silent(format!(
            "{name}: no frame within {seconds} s, {bytes} bytes in total: check its power and cable, and that \
             its scan is running"
        )));
    }
    let mut report = health::check(&quiet, instrument).map_err(|error| {
        let came = format!("{found} frames within {seconds} s, {bytes} bytes in total");
        CliError::failure(format!("{came}: {error}"))
    })?;
    // a scene whose skin cannot be modelled here, such as one that stores charge, can be checked nevertheless
    if let Ok(skin) = Skin::set_up(scene, &Default::default(), &mut progress) {
        health::check_model(&mut report, &quiet, &skin)?;
    }
    let exit = if report.verdict() == Verdict::Faulty { Exit::Faulty } else { Exit::Done };
    Ok(Ended { answer: answer(&name, &report, &quiet, &statistics), exit })
}

/// The name of a variant, as in the text.
fn word(variant: impl std::fmt::Debug) -> String {
    format!("{variant:?}").to_lowercase()
}

fn answer(
    name: &str,
    report: &HealthReport,
    quiet: &ReferenceFrames,
    statistics: &Statistics,
) -> Answer {
    let verdict = word(report.verdict());
    let number = |value: Option<f64>, digits: usize, unit: &str| {
        value.map_or_else(|| "unknown".to_owned(), |value| format!("{value:.digits$}{unit}"))
    };
    let (frames, lost) = (quiet.frames.values.nrows(), quiet.facts.lost_frames);
    let mut lines = vec![
        format!("{name}: {verdict}"),
        format!(
            "{frames} frames at {} Hz, {lost} lost, {} bytes damaged; signal-to-noise ratio {}, reciprocity error {}",
            number(report.frame_rate_hz, 2, ""),
            statistics.damaged_bytes,
            number(report.signal_to_noise_db, 1, " dB"),
            number(report.reciprocity, 3, ""),
        ),
    ];
    if let Some(Resolution { step, steps_per_touch, still }) = &report.resolution {
        lines.push(format!(
            "resolution {step:.2e}: a change of 1 % is {steps_per_touch:.1} steps; {still} of {} measurements never \
             change",
            report.noise_std.len()
        ));
    }
    let findings = report.findings.iter();
    lines.extend(findings.map(|finding| format!("{}: {finding}", word(finding.severity))));
    if report.findings.is_empty() {
        lines.push("no faults found".to_owned());
    }
    lines.extend(quiet.notices.iter().map(|notice| format!("notice of the instrument: {notice}")));
    let json = json!({
        "instrument": name,
        "verdict": verdict,
        "frames": frames,
        "lost_frames": lost,
        "damaged_bytes": statistics.damaged_bytes,
        "notices": quiet.notices,
    });
    Answer { text: lines.join("\n"), json: joined(json, numbers(report)) }
}

/// What was measured and found, for programs.
fn numbers(report: &HealthReport) -> Value {
    let finding = |finding: &Finding| {
        json!({
            "severity": word(finding.severity),
            // numbered from 1, as in the text
            "electrode": finding.electrode.map(|electrode| electrode + 1),
            "what": finding.to_string(),
            "try": finding.advice(),
        })
    };
    json!({
        "frame_rate_hz": report.frame_rate_hz,
        "signal_to_noise_db": report.signal_to_noise_db,
        "reciprocity_error": report.reciprocity,
        "resolution": report.resolution.map(|Resolution { step, steps_per_touch, still }| {
            json!({ "step": step, "steps_per_touch": steps_per_touch, "still_measurements": still })
        }),
        "findings": report.findings.iter().map(finding).collect::<Vec<_>>(),
    })
}
