"use strict";
// The registers beside the tree are what the instructions up to the current one have written.
const steps = [...document.querySelectorAll(".step")];
const registers = document.getElementById("registers");
let current = -1;

function show(at) {
    if (at < 0 || at >= steps.length) return;
    if (current >= 0) steps[current].classList.remove("current");
    current = at;
    const step = steps[at];
    step.classList.add("current");
    for (let around = step.parentElement; around; around = around.parentElement) {
        if (around.tagName === "DETAILS") around.open = true;
    }
    step.focus({ preventScroll: true });
    step.scrollIntoView({ block: "nearest" });
    const values = new Map();
    steps.slice(0, at + 1).forEach((of, number) => {
        for (const [register, name, value] of JSON.parse(of.dataset.changes)) {
            values.set(register, { name, value, number });
        }
    });
    registers.replaceChildren(...[...values].sort().map(([register, { name, value, number }]) => {
        const row = document.createElement("tr");
        row.className = number === at ? "now" : "";
        for (const text of [register, name === register ? "" : name, value]) {
            row.appendChild(document.createElement("td")).textContent = text;
        }
        return row;
    }));
}

document.addEventListener("keydown", (event) => {
    const by = { ArrowDown: 1, ArrowRight: 1, ArrowUp: -1, ArrowLeft: -1 }[event.key];
    if (by) {
        event.preventDefault();
        show(Math.max(0, current + by));
    } else if (event.key === "Enter" && current >= 0 && document.activeElement === steps[current]) {
        const around = steps[current].closest("details");
        if (around) around.open = !around.open;
    }
});
steps.forEach((step, at) => step.addEventListener("click", () => show(at)));
// The first that is not folded away.
show(Math.max(0, steps.findIndex((step) => !step.closest("details:not([open])"))));
