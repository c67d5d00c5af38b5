// Whether this browser is known to the session.

/// A session that was begun anew knows no browser: then the page is, which asks for the token. A browser does not say why a socket was refused, so this is asked for by itself.
export async function known() {
  const answer = await fetch("/healthz", { cache: "no-store" }).catch(() => null);
  if (answer?.status === 401) location.reload();
}
