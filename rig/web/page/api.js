// Requests to the server. A refusal is thrown as an Error whose message is the text that the command line would print.

async function answer(promise) {
  let response;
  try {
    response = await promise;
  } catch {
    throw new Error("the server does not answer: rig web has ended, or the connection is interrupted");
  }
  if (response.status === 403) throw new Error(await response.text());
  const found = await response.json().catch(() => ({ error: `the server failed (${response.status}); see its terminal` }));
  if (!response.ok) throw new Error(found.error);
  return found;
}

export const get = (path) => answer(fetch(path));

export const post = (path, body) =>
  answer(fetch(path, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) }));
