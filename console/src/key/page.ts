// The API key: entered once a session, tried at once.

import { make } from "../kit/element";
import { notice, problemNotice, say } from "../kit/notice";
import { type Page, heading } from "../route/router";
import { get } from "../service/client";
import { key, setKey } from "../service/key";

export function keyPage(): Page {
  const input = make("input", {
    type: "password",
    id: "key",
    autocomplete: "off",
    required: true,
    spellcheck: "false",
    "aria-describedby": "key-note",
  });
  const outcome = make("div", {});
  const forget = make("button", { type: "button", onclick: () => clear() }, "Forget the key");
  const show = () => {
    forget.hidden = key() === null;
  };
  const clear = () => {
    setKey(null);
    outcome.replaceChildren(
      notice({ title: "Forgotten", detail: "Requests are sent without a key now.", role: "status" }),
    );
    show();
    input.focus();
  };
  const save = async (event: Event) => {
    event.preventDefault();
    const before = key();
    setKey(input.value.trim());
    try {
      await get("/v1/jobs?limit=1");
      input.value = "";
      say("The key works");
      outcome.replaceChildren(
        notice({
          title: "The key works",
          detail: "It is kept until this tab is closed.",
          steps: [make("a", { class: "button primary", href: "#/jobs" }, "To the jobs")],
          role: "status",
        }),
      );
    } catch (error) {
      // A key that was refused does not take the place of one that works.
      setKey(before);
      outcome.replaceChildren(problemNotice(error));
      input.focus();
    }
    show();
  };
  show();
  const element = make(
    "div",
    { class: "page narrow" },
    heading("API key"),
    make(
      "p",
      { id: "key-note" },
      "A service with API keys answers only who has one. An operator makes it with ",
      make("code", {}, "mapfit keys create --tenant T --scopes read,submit"),
      ". It is kept in this tab's session storage, and sent to this service alone.",
    ),
    make(
      "form",
      { class: "stack", onsubmit: (event: Event) => void save(event) },
      make("label", { for: "key" }, "Key"),
      input,
      make("p", { class: "actions" }, make("button", { type: "submit", class: "primary" }, "Use this key"), forget),
    ),
    outcome,
  );
  return { title: "API key", element };
}
