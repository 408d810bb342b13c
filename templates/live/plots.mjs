// What can be plotted: names, a unit, and the values of a state that is shown.

const MILLI = { m: ["mm", 1e3], rad: ["mrad", 1e3] };

/**
 * Plots by key: label, unit, names and value(row) -> numbers.  A row has q, stiff, reference (joints' values of the
 * drives), tool (what it is off by: [from the program, from the rigid robot], m), energy ({kinetic, potential}), u.
 */
export function plotsOf(data) {
  const found = new Map();
  found.set("tool", {
    label: "tool: off its program, off the rigid robot",
    unit: "mm",
    names: ["off its program", "off the rigid robot"],
    value: ({ tool }) => tool.map((x) => 1e3 * x),
  });
  found.set("energy", {
    label: "energy",
    unit: "J",
    names: ["kinetic", "potential", "total"],
    value: ({ energy: { kinetic, potential } }) => [kinetic, potential, kinetic + potential],
  });
  if (data.drives.length) {
    found.set("drives", {
      label: "drives: errors",
      unit: data.drives.every(({ unit }) => unit === "m") ? "mm" : "mrad (mm)",
      names: data.drives.map(({ label }) => label).slice(0, 7),
      value: ({ q, reference }) => data.drives.slice(0, 7).map(({ joint }, i) => 1e3 * (q[joint] - reference[i])),
    });
    found.set("positions", {
      label: "drives: positions",
      unit: data.drives.every(({ unit }) => unit === "m") ? "m" : "rad (m)",
      names: data.drives.map(({ label }) => label).slice(0, 7),
      value: ({ q }) => data.drives.slice(0, 7).map(({ joint }) => q[joint]),
    });
  }
  for (const unit of ["rad", "m"]) {
    const [shownUnit, factor] = MILLI[unit];
    const groups = new Map();
    for (const i of data.deviations) {
      if (data.units[i] !== unit) continue;
      const joint = data.coordinates[i].split(".")[0];
      if (!groups.has(joint)) groups.set(joint, []);
      groups.get(joint).push(i);
    }
    for (const [joint, places] of groups) {
      found.set(`${joint}.${unit === "m" ? "translations" : "rotations"}`, {
        label: `${joint}: ${unit === "m" ? "translations" : "rotations"}`,
        unit: shownUnit,
        names: places.map((i) => data.coordinates[i].split(".")[1]),
        value: ({ q }) => places.map((i) => factor * q[i]),
      });
    }
  }
  return found;
}
