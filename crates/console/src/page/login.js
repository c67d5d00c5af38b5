// Sends the token to the session, then loads the page.

const of = (id) => document.getElementById(id);
const [form, token, said] = [of("login"), of("token"), of("said")];

form.addEventListener("submit", async (event) => {
  event.preventDefault();
  said.textContent = "";
  const body = JSON.stringify({ token: token.value });
  const answer = await fetch("/v1/login", { method: "POST", headers: { "content-type": "application/json" }, body }).catch(() => null);
  if (answer?.ok) {
    location.reload();
    return;
  }
  const why = answer ? (await answer.text()).trim() : "the session does not answer";
  said.textContent = `${why[0].toUpperCase()}${why.slice(1)}.`;
  token.select();
});
