// Which buildings deserve a look first.

// Whether nobody has to look at a building: it was measured, or somebody has looked.
const isSettled = (b) => b.status === "measured" || b.status === "reviewed";

// The worst first: those without a height and doubtful ones before measured ones, then by their uncertainty.
const byDoubt = (a, b) => isSettled(a) - isSettled(b) || (b.sigma ?? 1e6) - (a.sigma ?? 1e6);

// The highest of the buildings with a height, and the most unlikely: doubtful before measured, then by uncertainty.
function extremes(buildings) {
  const known = buildings.filter((b) => b.height !== null && b.status !== "refused");
  const isDoubtful = (b) => b.status === "doubtful";
  const worse = (a, b) => isDoubtful(b) - isDoubtful(a) || (b.sigma ?? 0) - (a.sigma ?? 0);
  const first = (order) => known.reduce((best, b) => (best === null || order(b, best) < 0 ? b : best), null);
  return { highest: first((a, b) => b.height - a.height), unlikely: first(worse) };
}
