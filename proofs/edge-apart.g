# An edge of a triangle at a pixel of a tile, in f32, where products and sums are rounded apart:
# TRIANGLE_EDGE, PLANE_ROW and PLANE_AT.
#
# Set-up divides the edge E0 + EX x + EY y by its bound, which is at least EDGE_ROUNDINGS u of
# |E0| + 32 |EX| + 32 |EY|, so that this sum is at most 2^24 / EDGE_ROUNDINGS. Over that set the
# error is below `error`: from 1 up a ray is surely inside, and below -1 it is surely outside. x and
# y are whole, since they are pixels from the middle of the tile.
#
# The set is covered by boxes; this is one of them, $E0, $EX and $EY being its sides.
@r = float<ieee_32, ne>;
e0 = r(E0); ex = r(EX); ey = r(EY);
down = r(ey * y); row = r(e0 + down);
across = r(ex * x); edge = r(row + across);
exact = E0 + EY * y + EX * x;
{ |E0| <= $E0 /\ |EX| <= $EX /\ |EY| <= $EY
  /\ |x| <= 32 /\ |y| <= 32 /\ @FIX(x, 0) /\ @FIX(y, 0)
  -> |edge - exact| <= $error }
