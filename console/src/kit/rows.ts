// A list that is refreshed in place: what stays keeps its element, and with it focus, selection and open menus.

/** A row's element, and how to show a newer state of its item. */
export interface Row<T> {
  element: HTMLElement;
  update(item: T): void;
}

/** Rows by key, in a parent that holds nothing else. */
export class Rows<T> {
  private readonly rows = new Map<string, Row<T>>();

  constructor(
    readonly parent: HTMLElement,
    private readonly key: (item: T) => string,
    private readonly make: (item: T) => Row<T>,
  ) {}

  /** Shows these items in this order. Elements are moved only where the order of what stays changed: moving one blurs it. */
  show(items: readonly T[]): void {
    const wanted = new Set(items.map(this.key));
    for (const [key, row] of this.rows) {
      if (wanted.has(key)) continue;
      const next = row.element.nextElementSibling ?? row.element.previousElementSibling;
      const focused = row.element.contains(document.activeElement);
      row.element.remove();
      this.rows.delete(key);
      if (focused) firstFocusable(next)?.focus();
    }
    let place = this.parent.firstElementChild;
    for (const item of items) {
      const key = this.key(item);
      let row = this.rows.get(key);
      if (row) {
        row.update(item);
      } else {
        row = this.make(item);
        this.rows.set(key, row);
      }
      if (row.element === place) place = place.nextElementSibling;
      else this.parent.insertBefore(row.element, place);
    }
  }

  /** Shows one item's newer state where it is listed. */
  update(item: T): void {
    this.rows.get(this.key(item))?.update(item);
  }
}

function firstFocusable(within: Element | null): HTMLElement | null {
  return within?.querySelector<HTMLElement>("a[href], button, input, select") ?? null;
}
