# A product of two sides of a triangle, in f64: NORMAL_PART. Sides are differences of corners that
# f32 holds, rounded once; the product loses at most `error` of itself, which is PACKET(rounding).
@r = float<ieee_64, ne>;
side_y = r(Y); side_z = r(Z);
product = r(side_y * side_z);
{ Y in [1b-149, 1b129] /\ Z in [1b-149, 1b129]
  -> |product -/ (Y * Z)| <= $error }
