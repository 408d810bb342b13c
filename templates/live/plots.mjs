// What can be plotted: names, a unit, and the values of a state that is shown.

const MILLI = { m: ["mm", 1e3], rad: ["mrad", 1e3] };

/** Unit of drives' values: of those that slide, that turn, or of both. */
function unitOf(drives, slides, turns) {
  const some = (unit) => drives.some((drive) => drive.unit === unit);
  return some("m") && some("rad") ? `${turns} or ${slides}` : some("m") ? slides : turns;
}

/**
 * Plots by key: label, unit, names and value(row) -> numbers.  A row has q, stiff, reference (joints' values of the
 * drives), states (of laws), tool (what it is off by: [from the program, from the rigid robot], m), energy ({kinetic, potential}), u.
 */
export function plotsOf(data) {
  const found = new Map();
  const programmed = data.drives.length > 0 && !data.closed, bends = data.deviations.length > 0 && !data.closed;
  if (programmed || bends) {
    const parts = [["off its program", programmed], ["off the rigid robot", bends]];
    const shownParts = parts.map(([name, there], i) => [name, there, i]).filter(([, there]) => there);
    found.set("tool", {
      label: `tool: ${shownParts.map(([name]) => name).join(", ")}`,
      unit: "mm",
      names: shownParts.map(([name]) => name),
      value: ({ tool }) => shownParts.map(([, , i]) => 1e3 * tool[i]),
    });
  }
  found.set("energy", {
    label: "energy",
    unit: "J",
    names: ["kinetic", "potential", "total"],
    value: ({ energy: { kinetic, potential } }) => [kinetic, potential, kinetic + potential],
  });
  if (data.drives.length) {
    found.set("drives", {
      label: "drives: errors",
      unit: unitOf(data.drives, "mm", "mrad"),
      names: data.drives.map(({ label }) => label).slice(0, 7),
      value: ({ q, reference }) => data.drives.slice(0, 7).map(({ joint }, i) => 1e3 * (q[joint] - reference[i])),
    });
    found.set("positions", {
      label: "drives: positions",
      unit: unitOf(data.drives, "m", "rad"),
      names: data.drives.map(({ label }) => label).slice(0, 7),
      value: ({ q }) => data.drives.slice(0, 7).map(({ joint }) => q[joint]),
    });
  }
  for (const unit of new Set(data.states.map((state) => state.unit))) {
    const [shownUnit, factor] = MILLI[unit] ?? [unit, 1], places = [...data.states.keys()].filter((i) => data.states[i].unit === unit).slice(0, 7);
    found.set(`states.${unit}`, {
      label: `internal states, ${shownUnit}`,
      unit: shownUnit,
      names: places.map((i) => data.states[i].name),
      value: ({ states }) => places.map((i) => factor * states[i]),
    });
  }
  for (const [unit, kind] of [["rad", "rotations"], ["m", "translations"], ["1", "modes"]]) {
    const [shownUnit, factor] = MILLI[unit] ?? [unit, 1];
    const groups = new Map();
    for (const i of data.deviations) {
      if (data.units[i] !== unit) continue;
      const joint = data.coordinates[i].split(".")[0];
      if (!groups.has(joint)) groups.set(joint, []);
      groups.get(joint).push(i);
    }
    for (const [joint, places] of groups) {
      found.set(`${joint}.${kind}`, {
        label: `${joint}: ${kind}`,
        unit: shownUnit,
        names: places.map((i) => data.coordinates[i].split(".")[1]),
        value: ({ q }) => places.map((i) => factor * q[i]),
      });
    }
  }
  return found;
}
