// Questions before what cannot be undone.

import { make } from "./element";

export interface Question {
  title: string;
  detail: string;
  /** What the button that does it says; the other one keeps things as they are. */
  yes: string;
  no: string;
}

/** Asks; false on Escape too. The native dialog traps focus and gives it back. */
export function ask(question: Question): Promise<boolean> {
  return new Promise((resolve) => {
    const close = (answer: boolean) => () => {
      resolve(answer);
      dialog.close();
    };
    const dialog = make(
      "dialog",
      { class: "question", "aria-labelledby": "question-title", "aria-describedby": "question-detail" },
      make("h2", { id: "question-title" }, question.title),
      make("p", { id: "question-detail" }, question.detail),
      make(
        "div",
        { class: "actions" },
        make("button", { type: "button", class: "plain", autofocus: true, onclick: close(false) }, question.no),
        make("button", { type: "button", class: "danger", onclick: close(true) }, question.yes),
      ),
    );
    dialog.addEventListener("close", () => {
      resolve(false);
      dialog.remove();
    });
    document.body.append(dialog);
    dialog.showModal();
  });
}
