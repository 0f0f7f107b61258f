//! The web clients of the bridge: passes the reports of their connections to the machine, and the end of a session to them.

use std::rc::Rc;

use super::shared::{Core, Shared};
use crate::session::web::{Hello, WebEnd, WebRefusal};
use crate::shell::tasks::Beat;
use crate::shell::web::control::{Admitted, Report, Reports};

/// Handles the reports of all connections, one by one: each connection waits for its turn.
pub(super) async fn serve(shared: Rc<Shared>, beat: Rc<Beat>, mut reports: Reports) {
    // The reports end when the connections' thread has ended: nobody is served without it.
    while let Some(report) = beat.during(reports.recv()).await {
        take(&shared, report);
        // A client that sends continuously must not block vehicles and timers.
        beat.during(tokio::task::yield_now()).await;
    }
}

fn take(shared: &Shared, report: Report) {
    match report {
        Report::Hello {
            number,
            from,
            of_vsm,
            frame,
            answer,
        } => {
            let admitted = shared.with(|core, now| {
                if core.lease_has_ended() {
                    return Err(WebRefusal::Ends);
                }
                let vsm = core.config.dli.vsm_id;
                let hello = Hello::parse(&frame, vsm, of_vsm)?;
                let Core {
                    bridge, store, web, ..
                } = core;
                let opened = bridge.open_web(now, (number, from), &hello, store)?;
                if let Some(before) = opened.replaces {
                    web.end(before, WebRefusal::Replaced);
                }
                let mut end = WebEnd::new(opened.key, hello.cucs());
                Ok(Admitted {
                    welcome: end.seal(&opened.welcome),
                    end,
                    cucs: hello.cucs(),
                    ends: web.add(number),
                })
            });
            // The client disconnected while it was admitted, so nobody will report its end.
            if let Err(unsent) = answer.send(admitted)
                && unsent.is_ok()
            {
                close(shared, number, None);
            }
        }
        Report::Datagram {
            number,
            from,
            bytes,
        } => shared.with(|core, now| {
            let Core { bridge, store, .. } = core;
            if let (Some(recording), Some(page)) = (&mut core.dli_recording, &core.config.http) {
                recording.received(now.wall, from, page.listen, &bytes);
            }
            bridge.handle_web(now, number, &bytes, store);
        }),
        Report::Closed { number, why } => close(shared, number, why),
        Report::Refused { from, why } => {
            shared.with(|core, now| core.bridge.note_web(now.mono, from, None, why));
        }
    }
}

fn close(shared: &Shared, number: u64, why: Option<WebRefusal>) {
    shared.with(|core, now| {
        core.web.remove(number);
        core.bridge.close_web(now.mono, number, why);
    });
}
