// A field of the form: label, input, hint, and the fault the service found with it.

import { make } from "../kit/element";

export interface Field {
  element: HTMLElement;
  input: HTMLInputElement;
  /** Where it stands in a job's body, as the service's faults name it. */
  pointer: string;
  fault(detail: string | null): void;
}

export function field(
  label: string,
  pointer: string,
  attributes: Record<string, string | number | boolean>,
  hint?: string,
): Field {
  const id = `field${pointer.replaceAll("/", "-")}`;
  const input = make("input", { id, autocomplete: "off", ...attributes });
  const note = make("p", { id: `${id}-hint`, class: "note", hidden: !hint }, hint);
  const wrong = make("p", { id: `${id}-fault`, class: "fault", role: "alert", hidden: true });
  input.setAttribute("aria-describedby", `${id}-hint ${id}-fault`);
  const fault = (detail: string | null) => {
    wrong.hidden = detail === null;
    wrong.textContent = detail;
    if (detail === null) input.removeAttribute("aria-invalid");
    else input.setAttribute("aria-invalid", "true");
  };
  input.addEventListener("input", () => fault(null));
  const element = make("div", { class: "form-field" }, make("label", { for: id }, label), input, note, wrong);
  return { element, input, pointer, fault };
}

/** A positive length or angle. */
export function positive(label: string, pointer: string, value: number, hint?: string): Field {
  return field(
    label,
    pointer,
    { type: "number", value, min: 0, step: "any", required: true, inputmode: "decimal" },
    hint,
  );
}

export function whole(label: string, pointer: string, value: number | "", least: number, hint?: string): Field {
  return field(label, pointer, { type: "number", value, min: least, step: 1, inputmode: "numeric" }, hint);
}
