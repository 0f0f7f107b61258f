//! The tasks of a program: if one ends, panics or hangs, all of them end.
//!
//! A partly running program is worse than none. If a bridge can no longer receive commands but still sends heartbeats, PX4
//! does not start its failsafe, and a service manager that still gets its pings never restarts it. So:
//!
//! - [`Tasks::run`] returns at the first task that ends, whether it returned or panicked, and names it; only one that has
//!   reported that it is no longer needed ([`Beat::finish`]) may return;
//! - a round goes through every task by its [`Beat`], once a second or faster. Only a round that all have answered
//!   feeds the service manager's watchdog; a task that does not answer for [`STUCK_AFTER`] ends the program, also where
//!   no service manager waits.
//!
//! A panic outside these tasks (another thread, a connection of the status page) ends the process by the hook that
//! `program::process::end_on_panic` sets, and in release builds by `panic = "abort"`.
//!
//! Everything here is on one thread: a beat costs a task two cells for each poll, and no lock.

use std::cell::{Cell, RefCell};
use std::fmt;
use std::future::{Future, poll_fn};
use std::pin::{Pin, pin};
use std::rc::Rc;
use std::task::{Context, Waker};
use std::time::Duration;

use tokio::sync::Notify;
use tokio::task::{Id, JoinError, JoinSet, LocalSet};
use tokio::time::MissedTickBehavior;

use super::service;

/// Why a program that serves cannot continue.
#[derive(Debug, thiserror::Error)]
pub enum TaskFault {
    /// It returned, which no task does while the program serves.
    #[error(
        "the task \"{task}\" ended while it was needed: stopping, so that the program can be started again"
    )]
    Ended {
        /// Its name.
        task: &'static str,
    },
    /// It panicked. The panic's own line is in the log before.
    #[error("the task \"{task}\" panicked: stopping, so that the program can be started again")]
    Panicked {
        /// Its name.
        task: &'static str,
    },
    /// It does not answer.
    #[error(
        "the task \"{task}\" has not answered for {} s: stopping, so that the program can be started again",
        STUCK_AFTER.as_secs()
    )]
    Stuck {
        /// Its name.
        task: &'static str,
    },
}

/// Shows that a task is working.
#[derive(Debug, Default)]
pub struct Beat {
    /// It returns because it is no longer needed.
    done: Cell<bool>,
    asked: Cell<u64>,
    answered: Cell<u64>,
    waker: RefCell<Option<Waker>>,
}

impl Beat {
    /// Waits for `work`, the one place where a task may wait for long, and answers every round meanwhile.
    ///
    /// Anything that a task awaits elsewhere must complete within [`STUCK_AFTER`].
    pub async fn during<T>(&self, work: impl Future<Output = T>) -> T {
        let mut work = pin!(work);
        poll_fn(|context| {
            // Before the work: work that is ready at each poll, such as a socket in a flood, must not delay the answer.
            self.answer(context);
            work.as_mut().poll(context)
        })
        .await
    }

    /// The task is about to return because it is no longer needed.
    pub fn finish(&self) {
        self.done.set(true);
    }

    fn answer(&self, context: &Context<'_>) {
        self.answered.set(self.asked.get());
        let mut waker = self.waker.borrow_mut();
        if !waker
            .as_ref()
            .is_some_and(|waker| waker.will_wake(context.waker()))
        {
            *waker = Some(context.waker().clone());
        }
    }

    fn ask(&self, round: u64) {
        self.asked.set(round);
        if let Some(waker) = self.waker.borrow().as_ref() {
            waker.wake_by_ref();
        }
    }

    fn has_answered(&self) -> bool {
        self.answered.get() == self.asked.get()
    }
}

/// Tasks that need each other.
#[derive(Debug, Default)]
pub struct Tasks {
    set: JoinSet<()>,
    members: Vec<Member>,
    later: Later,
}

/// A handle to add tasks while others run.
#[derive(Clone, Default)]
pub struct Later(Rc<Waiting>);

#[derive(Default)]
struct Waiting {
    tasks: RefCell<Vec<(&'static str, Begin)>>,
    added: Notify,
}

type Begin = Box<dyn FnOnce(Rc<Beat>) -> Pin<Box<dyn Future<Output = ()>>>>;

impl Later {
    /// As [`Tasks::spawn`], for tasks that run already.
    pub fn spawn<F>(&self, name: &'static str, task: impl FnOnce(Rc<Beat>) -> F + 'static)
    where
        F: Future<Output = ()> + 'static,
    {
        let begin: Begin = Box::new(|beat| Box::pin(task(beat)));
        self.0.tasks.borrow_mut().push((name, begin));
        self.0.added.notify_one();
    }
}

impl fmt::Debug for Later {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = self.0.tasks.borrow();
        let names = names.iter().map(|(name, _)| name);
        f.debug_list().entries(names).finish()
    }
}

#[derive(Debug)]
struct Member {
    id: Id,
    name: &'static str,
    beat: Rc<Beat>,
}

impl Tasks {
    /// Adds a task, and passes it the beat by which it answers.
    pub fn spawn<F>(
        &mut self,
        local: &LocalSet,
        name: &'static str,
        task: impl FnOnce(Rc<Beat>) -> F,
    ) where
        F: Future<Output = ()> + 'static,
    {
        let beat = Rc::new(Beat::default());
        let task = super::test_fault::broken(name, task(beat.clone()));
        let id = self.set.spawn_local_on(task, local).id();
        self.members.push(Member { id, name, beat });
    }

    /// Adds tasks while these run.
    #[must_use]
    pub fn later(&self) -> Later {
        self.later.clone()
    }

    fn begin_added(&mut self) {
        for (name, begin) in self.later.0.tasks.take() {
            let beat = Rc::new(Beat::default());
            let id = self.set.spawn_local(begin(beat.clone())).id();
            self.members.push(Member { id, name, beat });
        }
    }

    /// Runs until `stop` is done, and feeds the service manager's watchdog meanwhile. To be awaited within the
    /// [`LocalSet`] of the tasks.
    ///
    /// # Errors
    /// A task has ended, or does not answer.
    pub async fn run(mut self, stop: impl Future<Output = ()>) -> Result<(), TaskFault> {
        let mut stop = pin!(stop);
        // Two pings in each period of the service manager; one round a second if that is long or there is no service
        // manager.
        let pause = service::ping_interval().map_or(ROUND, |ping| ping.min(ROUND));
        let mut ticks = tokio::time::interval(pause);
        // After the process was suspended, missed rounds must not count as unanswered.
        ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let later = self.later.clone();
        let (mut round, mut unanswered) = (0_u64, Duration::ZERO);
        loop {
            tokio::select! {
                () = &mut stop => return Ok(()),
                Some(ended) = self.set.join_next_with_id() => match ended {
                    Ok((id, ())) if self.is_done(id) => self.members.retain(|member| member.id != id),
                    ended => return Err(self.fault(ended)),
                },
                () = later.0.added.notified() => self.begin_added(),
                _ = ticks.tick() => {
                    if let Some(silent) = self.members.iter().find(|member| !member.beat.has_answered()) {
                        unanswered += pause;
                        if unanswered >= STUCK_AFTER {
                            return Err(TaskFault::Stuck { task: silent.name });
                        }
                        continue;
                    }
                    if round > 0 {
                        service::alive();
                    }
                    unanswered = Duration::ZERO;
                    round += 1;
                    self.members.iter().for_each(|member| member.beat.ask(round));
                }
            }
        }
    }

    fn is_done(&self, id: Id) -> bool {
        let mut members = self.members.iter();
        members.any(|member| member.id == id && member.beat.done.get())
    }

    fn fault(&self, ended: Result<(Id, ()), JoinError>) -> TaskFault {
        let (id, returned) = match &ended {
            Ok((id, ())) => (*id, true),
            Err(cause) => (cause.id(), false),
        };
        let member = self.members.iter().find(|member| member.id == id);
        let task = member.map_or("unknown", |member| member.name);
        if returned {
            TaskFault::Ended { task }
        } else {
            TaskFault::Panicked { task }
        }
    }
}

const ROUND: Duration = Duration::from_secs(1);

/// How long a task may leave a round unanswered. Less than `WatchdogSec` of the unit, so that the log names the hanging task
/// before the service manager kills the process.
pub const STUCK_AFTER: Duration = Duration::from_secs(4);

#[cfg(test)]
mod tests {
    use super::*;

    /// Runs a good task beside another, for a minute.
    async fn beside<F: Future<Output = ()> + 'static>(
        other: impl FnOnce(Rc<Beat>) -> F,
    ) -> (Result<(), TaskFault>, Duration) {
        let local = LocalSet::new();
        let mut tasks = Tasks::default();
        tasks.spawn(&local, "good", |beat| async move {
            loop {
                beat.during(tokio::time::sleep(Duration::from_secs(7)))
                    .await;
            }
        });
        tasks.spawn(&local, "other", other);
        let began = tokio::time::Instant::now();
        let stop = tokio::time::sleep(Duration::from_secs(60));
        let ended = local.run_until(tasks.run(stop)).await;
        (ended, began.elapsed())
    }

    #[tokio::test(start_paused = true)]
    async fn tasks_that_wait_for_their_work_are_alive() {
        let (ended, after) = beside(|beat| async move {
            beat.during(std::future::pending::<()>()).await;
        })
        .await;
        assert!(ended.is_ok(), "{ended:?}");
        assert_eq!(after, Duration::from_secs(60));
    }

    #[tokio::test(start_paused = true)]
    async fn a_task_that_always_has_work_is_alive() {
        let (ended, _) = beside(|beat| async move {
            loop {
                beat.during(async {}).await;
                tokio::time::sleep(Duration::from_millis(1)).await;
            }
        })
        .await;
        assert!(ended.is_ok(), "{ended:?}");
    }

    #[tokio::test(start_paused = true)]
    async fn a_task_that_returns_ends_all() {
        let (ended, after) =
            beside(|_| async { tokio::time::sleep(Duration::from_millis(300)).await }).await;
        assert!(matches!(ended, Err(TaskFault::Ended { task: "other" })));
        assert!(after < Duration::from_secs(1));
    }

    #[tokio::test(start_paused = true)]
    async fn a_task_that_panics_ends_all() {
        let (ended, after) = beside(|_| async {
            tokio::time::sleep(Duration::from_millis(300)).await;
            panic!("on purpose");
        })
        .await;
        assert!(matches!(ended, Err(TaskFault::Panicked { task: "other" })));
        assert!(after < Duration::from_secs(1));
    }

    #[tokio::test(start_paused = true)]
    async fn a_task_that_is_added_later_is_one_of_them_until_it_is_not_needed() {
        for finishes in [true, false] {
            let local = LocalSet::new();
            let mut tasks = Tasks::default();
            let later = tasks.later();
            tasks.spawn(&local, "first", |beat| async move {
                later.spawn("second", move |beat| async move {
                    beat.during(tokio::time::sleep(Duration::from_secs(20)))
                        .await;
                    if finishes {
                        beat.finish();
                    }
                });
                beat.during(std::future::pending::<()>()).await;
            });
            let stop = tokio::time::sleep(Duration::from_secs(60));
            let ended = local.run_until(tasks.run(stop)).await;
            match ended {
                Ok(()) => assert!(finishes),
                Err(fault) => {
                    assert!(matches!(fault, TaskFault::Ended { task: "second" }));
                    assert!(!finishes);
                }
            }
        }
    }

    #[tokio::test(start_paused = true)]
    async fn a_task_that_waits_for_something_else_ends_all() {
        let (ended, after) = beside(|beat| async move {
            beat.during(tokio::time::sleep(Duration::from_secs(10)))
                .await;
            std::future::pending::<()>().await;
        })
        .await;
        assert!(matches!(ended, Err(TaskFault::Stuck { task: "other" })));
        let bound = Duration::from_secs(12)..Duration::from_secs(17);
        assert!(bound.contains(&after), "{after:?}");
    }
}
