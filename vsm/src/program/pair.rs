//! `vsm pair`: pairs this VSM with a vehicle's air-side agent.

use std::io::Read as _;
use std::time::Duration;

use crate::shell::key_file::system_random;
use crate::shell::key_store::KeyStore;
use crate::shell::pairing::{Ending, Pairing};
use anyhow::anyhow;
use clap::Args;
use mavlink_link::exchange::{InitiatorEvent, PairingCode};
use zeroize::Zeroizing;

use super::key::{Which, open};
use super::process::{Failure, bad, failed, print_line, runtime};

#[derive(Debug, Args)]
pub(crate) struct Pair {
    #[command(flatten)]
    which: Which,
    /// Use the code that `vsm airside pair` shows; `-` reads it from standard input, which is safer: every user of this
    /// computer can see arguments in the list of processes. Without it a new code is made and shown
    #[arg(long)]
    code: Option<String>,
    /// Try for at most this long, s; the agent's window is open for 10 minutes (600 s)
    #[arg(long, default_value_t = 600)]
    wait_s: u64,
}

pub(crate) fn run(arguments: Pair) -> Result<(), Failure> {
    let Pair {
        which,
        code,
        wait_s,
    } = arguments;
    let code = read_code(code).map_err(bad)?;
    let (config, vehicle, path, exchange) = open(&which)?;
    let runtime = runtime()?;
    let ending = runtime.block_on(async {
        let pairing = Pairing::open(&config, &vehicle, (&path, exchange), code).map_err(failed)?;
        print_line(&format!(
            "this VSM's fingerprint: {}",
            pairing.own_key().fingerprint()
        ));
        print_line(&format!(
            "pairing with vehicle {} on {}; for {wait_s} s at most (--wait-s)",
            vehicle.id, vehicle.link
        ));
        let patience = Duration::from_secs(wait_s);
        Ok(pairing.run(patience, &mut |event| report(event)).await)
    })?;
    match ending {
        Ending::Paired { peer, key } => {
            print_line(&format!("the agent's fingerprint: {}", peer.fingerprint()));
            print_line(&format!(
                "paired: key {key} waits for the vehicle; compare both fingerprints with the agent's, then start \
                          `vsm run`"
            ));
            // A first key is in force as soon as the vehicle has it, and `vsm run` has no other.
            let keys = KeyStore::open(&path).map_err(failed)?;
            let none = keys.current().map_err(failed)?.is_none();
            if none {
                keys.commit().map_err(failed)?;
            }
            Ok(())
        }
        Ending::NotAnswered(unproven) => {
            let unproven = unproven.map_or(String::new(), |status| {
                format!("; last unproven answer: {status}")
            });
            Err(failed(anyhow!(
                "nobody answered with this code within {wait_s} s: is the agent's window open (`vsm airside pair`), and \
                 the code the same{unproven}"
            )))
        }
    }
}

/// The code given, or a new one, which is shown.
fn read_code(code: Option<String>) -> anyhow::Result<PairingCode> {
    let text = match code.map(Zeroizing::new) {
        None => {
            let code = PairingCode::generate(&mut system_random)?;
            print_line(&format!("pairing code: {}", *code.text()));
            return Ok(code);
        }
        // Read from standard input: an argument would be visible in the list of processes.
        Some(dash) if *dash == "-" => {
            let mut text = Zeroizing::new(String::with_capacity(256));
            std::io::stdin().take(256).read_to_string(&mut text)?;
            text
        }
        Some(text) => text,
    };
    Ok(PairingCode::parse(&text)?)
}

fn report(event: &InitiatorEvent) {
    match event {
        InitiatorEvent::GaveUp { .. } => print_line("no answer yet; trying again"),
        InitiatorEvent::Rejected { status } => print_line(&format!("unproven answer: {status}")),
        InitiatorEvent::NotStored(cause) => print_line(&format!("not stored: {cause}")),
        InitiatorEvent::NoRandom => print_line("the system has no random bytes"),
        _ => {}
    }
}
