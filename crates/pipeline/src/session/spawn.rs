//! Threads of a session: named, and with the scheduling grant of their role.

use std::thread::{Builder, Scope, ScopedJoinHandle};

use super::priority::{Role, SchedulingPolicy};

/// Starts a named thread with the scheduling grant of its role.
pub(super) fn spawn<'scope, 'env, T: Send + 'scope>(
    scope: &'scope Scope<'scope, 'env>,
    name: &str,
    (policy, role): (&SchedulingPolicy, Role),
    run: impl FnOnce() -> T + Send + 'scope,
) -> ScopedJoinHandle<'scope, T> {
    let policy = policy.clone();
    let run = move || {
        policy.enter(role);
        run()
    };
    Builder::new().name(name.into()).spawn_scoped(scope, run).unwrap_or_else(|error| panic!("thread {name}: {error}"))
}

/// Ends a scope's other threads if this thread panics: the scope waits for them, and they would run
/// for ever.
pub(super) struct EndOnPanic<F: Fn()>(pub(super) F);

impl<F: Fn()> Drop for EndOnPanic<F> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            (self.0)();
        }
    }
}

/// Waits for a thread and returns its result; a panic is propagated.
pub(super) fn joined<T>(thread: ScopedJoinHandle<'_, T>) -> T {
    thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}
