// Kinds of light by the sun's elevation in degrees: from the lowest sun of the day's model, and to the end of civil twilight.
export const LIGHTS = { Day: { low: 3, high: 90, usual: 35 }, Dusk: { low: -6, high: 3, usual: -3 }, Night: { low: -90, high: -6, usual: -10 } };
export const lightTitle = ({ low, high }) => (low === -90 ? `sun below ${high}°` : high === 90 ? `sun from ${low}°` : `sun from ${low}° to ${high}°`).replaceAll("-", "−");
