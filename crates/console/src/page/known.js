// Checks whether the session still admits this browser.

/// A restarted session has forgotten all browsers; reloading then shows the login page. A
/// browser does not report why a socket was refused, so a separate request finds out.
export async function known() {
  const answer = await fetch("/healthz", { cache: "no-store" }).catch(() => null);
  if (answer?.status === 401) location.reload();
}
