// What the caller may do: the role of its token, which the server tells. Views offer nothing that it would refuse.
import { get, token } from "./api.js";

let known = { token: undefined, role: "", refused: new Set() };

// Ask for the role unless it is known for the present token.
export async function learnRole() {
  if (known.token === token()) return;
  const { role, refused } = await get("/v1/access");
  known = { token: token(), role, refused: new Set(refused) };
}

export const role = () => known.role;
// `endpoint` as the server names it: "POST /v1/runs".
export const may = (endpoint) => !known.refused.has(endpoint);
