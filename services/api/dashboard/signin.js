// Sign-in by the operator's OpenID provider: to its page and back with a code, which the server redeems for a token (PKCE).
const LEFT = "valerie-signing-in"; // of this tab: the secrets of this attempt, and the view to return to

const random = () => code(crypto.getRandomValues(new Uint8Array(32)));
const code = (data) => btoa(String.fromCharCode(...new Uint8Array(data))).replaceAll("+", "-").replaceAll("/", "_").replaceAll("=", "");
const here = () => `${location.origin}${location.pathname}`;

// The provider's page and this server's name there; null without a provider, or where browsers have no cryptography.
export async function offered() {
  if (!crypto.subtle) return null;
  const offer = await fetch("/v1/sign-in").then((answer) => (answer.ok ? answer.json() : null), () => null);
  return offer?.page ? offer : null;
}

export async function leave({ page, client }) {
  const attempt = { verifier: random(), state: random(), nonce: random(), hash: location.hash };
  sessionStorage.setItem(LEFT, JSON.stringify(attempt));
  const address = new URL(page);
  const challenge = code(await crypto.subtle.digest("SHA-256", new TextEncoder().encode(attempt.verifier)));
  for (const [name, value] of Object.entries({ response_type: "code", client_id: client, redirect_uri: here(), scope: "openid email profile", state: attempt.state, nonce: attempt.nonce, code_challenge: challenge, code_challenge_method: "S256" })) address.searchParams.set(name, value);
  location.assign(address);
}

// The token of a sign-in that has just come back; null if none has.
export async function arrived() {
  const answer = new URLSearchParams(location.search);
  const left = JSON.parse(sessionStorage.getItem(LEFT) ?? "null");
  if (!answer.has("state") || answer.get("state") !== left?.state) return null;
  sessionStorage.removeItem(LEFT);
  history.replaceState(history.state, "", `${here()}${left.hash}`);
  if (!answer.has("code")) throw new Error(`The sign-in failed: ${answer.get("error_description") ?? answer.get("error") ?? "no reason given"}`);
  const response = await fetch("/v1/sign-in", { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify({ code: answer.get("code"), verifier: left.verifier, nonce: left.nonce, redirect_uri: here() }) });
  const { secret, detail } = await response.json();
  if (!secret) throw new Error(`The sign-in failed: ${detail}`);
  return secret;
}
