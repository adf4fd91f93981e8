// Real orthonormal spherical harmonics in prtnet's convention: index l*l + l + m, no Condon-Shortley phase, evaluated
// on world x, y, z, so that Y_1 = sqrt(3 / 4 pi) (y, z, x). The pole is z although up is y.

// Y_i of a unit direction, for i < bands * bands: the recurrences of prtnet.sh.evaluate.
export function evaluate([x, y, z], bands) {
  const out = new Array(bands * bands);
  let cosine = 1, sine = 0, diagonal = Math.sqrt(1 / (4 * Math.PI));
  for (let m = 0; m < bands; m++) {
    if (m > 0) {
      [cosine, sine] = [x * cosine - y * sine, x * sine + y * cosine];
      diagonal *= Math.sqrt((2 * m + 1) / (2 * m));
    }
    let before = 0, legendre = m > 0 ? Math.SQRT2 * diagonal : diagonal;
    for (let l = m; l < bands; l++) {
      if (l > m) {
        const ahead = Math.sqrt((4 * l * l - 1) / (l * l - m * m));
        const behind = l > m + 1 ? Math.sqrt(((l - 1) ** 2 - m * m) / (4 * (l - 1) ** 2 - 1)) : 0;
        [before, legendre] = [legendre, ahead * (z * legendre - behind * before)];
      }
      out[l * l + l + m] = legendre * cosine;
      if (m > 0) out[l * l + l - m] = legendre * sine;
    }
  }
  return out;
}

// Nodes in [-1, 1] and weights that integrate polynomials of degree 2 count - 1 exactly (Gauss and Legendre).
function gauss(count) {
  return Array.from({ length: count }, (_, i) => {
    let z = Math.cos((Math.PI * (i + 0.75)) / (count + 0.5)), slope = 1;
    for (let step = 0; step < 12; step++) {
      let before = 1, value = z;
      for (let l = 2; l <= count; l++) [before, value] = [value, ((2 * l - 1) * z * value - (l - 1) * before) / l];
      slope = (count * (before - z * value)) / (1 - z * z);
      z -= value / slope;
    }
    return [z, 2 / ((1 - z * z) * slope * slope)];
  });
}

// The coefficients, [[r, g, b], ...], of a light turned about +y by degrees, from +z towards +x: L'(w) = L(R^-1 w).
// About y all coefficients of a band mix, so the turned light is projected again, exactly, by a quadrature.
export function turnedAboutY(coefficients, degrees) {
  const bands = Math.round(Math.sqrt(coefficients.length)), around = 2 * bands - 1;
  const cosine = Math.cos((degrees * Math.PI) / 180), sine = Math.sin((degrees * Math.PI) / 180);
  const out = coefficients.map(() => [0, 0, 0]);
  for (const [z, weight] of gauss(bands)) {
    for (let j = 0; j < around; j++) {
      const angle = (2 * Math.PI * (j + 0.5)) / around, radius = Math.sqrt(1 - z * z);
      const [x, y] = [radius * Math.cos(angle), radius * Math.sin(angle)];
      const before = evaluate([cosine * x - sine * z, y, sine * x + cosine * z], bands);
      const light = [0, 1, 2].map((c) => coefficients.reduce((sum, rgb, i) => sum + rgb[c] * before[i], 0));
      evaluate([x, y, z], bands).forEach((basis, i) => {
        for (let c = 0; c < 3; c++) out[i][c] += ((2 * Math.PI) / around) * weight * basis * light[c];
      });
    }
  }
  return out;
}
