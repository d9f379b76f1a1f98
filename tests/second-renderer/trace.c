/* Rays of a plenoptic camera, from the sensor outwards to the board.
 *
 * Lengths are mm. The world's origin is the nominal principal point of the main lens; z points from the lens to the
 * sensor, so that boards have z < 0; x is right and y down on the sensor. The array's frame is the world's, moved to
 * the array and tilted with it: its plane z = 0 holds the microlenses, its plane z = b the sensor.
 * Both lenses are ideal: a ray that meets the lens at h from its centre leaves with slope s - h/f, which images every
 * point of every plane exactly. Spheres refract by Snell's law in vectors. Nothing here is paraxial.
 */
#include <math.h>
#include <stddef.h>

typedef struct {
  double point[3], along_x[3], along_y[3], normal[3]; /* a plane in the world; unit vectors */
  double x_min, x_max, y_min, y_max;                  /* its edges in its own coordinates, mm */
  double texel, shift_x, shift_y;                     /* mm a texel; shift of the texture in texels */
  double low, high;                                   /* what texture values 0 and 1 shine with */
  const float *texture;                               /* height x width, repeats; NULL shines with `high` */
  int width, height;
} Board;

typedef struct {
  double b, f_mla, f;            /* array to sensor; focal lengths */
  double pixel, axis_x, axis_y;  /* pixel size; pixel that lies at the array frame's x = y = 0 */
  double stop;                   /* radius of the main lens's aperture */
  double microlens;              /* radius of a microlens */
  double first[2], second[2], origin[2]; /* lattice of microlenses, array frame */
  double array_turn[9], array_at[3];     /* columns: the array's axes in the world; its origin */
  double lens_turn[9], lens_at[3];       /* the same of the main lens */
  double shell_at[3], inner, outer, n_shell, n_out; /* inner = 0: no shell, all is air */
  double background;             /* what shines beside the boards */
  int baffled;                   /* 1: a pixel sees its own microlens only; 0: all of them */
  int boards;
  Board board[8];
} Scene;

typedef struct { double at[3], to[3]; } Ray;

static double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
static void into_world(const double *m, const double *v, double *out) { /* turn only */
  for (int i = 0; i < 3; i++) out[i] = m[3 * i] * v[0] + m[3 * i + 1] * v[1] + m[3 * i + 2] * v[2];
}
static void out_of_world(const double *m, const double *v, double *out) {
  for (int i = 0; i < 3; i++) out[i] = m[i] * v[0] + m[3 + i] * v[1] + m[6 + i] * v[2];
}

/* Moves the ray, which is inside the sphere, to the sphere, and refracts it there by the ratio of indices n1/n2.
 * Returns 0 where it does not get out: it misses, or is totally reflected. */
static int leave_sphere(Ray *ray, const double *centre, double radius, double ratio) {
  double from[3] = {ray->at[0] - centre[0], ray->at[1] - centre[1], ray->at[2] - centre[2]};
  double along = dot(from, ray->to), beyond = dot(from, from) - radius * radius;
  double under_root = along * along - beyond;
  if (under_root < 0) return 0;
  double way = sqrt(under_root) - along;
  if (way < 0) return 0;
  double normal[3];
  for (int i = 0; i < 3; i++) {
    ray->at[i] += way * ray->to[i];
    normal[i] = (ray->at[i] - centre[i]) / radius; /* outwards, the way the ray goes */
  }
  double cosine = dot(normal, ray->to);
  double left = 1 - ratio * ratio * (1 - cosine * cosine);
  if (left < 0) return 0;
  double turn = sqrt(left) - ratio * cosine;
  for (int i = 0; i < 3; i++) ray->to[i] = ratio * ray->to[i] + turn * normal[i];
  return 1;
}

/* The ray from pixel p (array frame, on the sensor) through the point u of the microlens with centre c, beyond the
 * main lens and, where there is one, the shell. `blocked` takes whether the main lens's aperture stops it.
 * Returns 0 where glass does not let it through. */
static int trace(const Scene *scene, const double *p, const double *u, const double *c, Ray *ray, int *blocked) {
  double sx = (u[0] - p[0]) / scene->b - (u[0] - c[0]) / scene->f_mla;
  double sy = (u[1] - p[1]) / scene->b - (u[1] - c[1]) / scene->f_mla;
  double at[3] = {u[0], u[1], 0}, to[3] = {sx, sy, -1}, world_at[3], world_to[3];
  into_world(scene->array_turn, at, world_at);
  into_world(scene->array_turn, to, world_to);
  for (int i = 0; i < 3; i++) world_at[i] += scene->array_at[i] - scene->lens_at[i];
  /* In the main lens's frame. */
  out_of_world(scene->lens_turn, world_at, at);
  out_of_world(scene->lens_turn, world_to, to);
  double way = at[2] / -to[2];
  double m[3] = {at[0] + way * to[0], at[1] + way * to[1], 0};
  *blocked = m[0] * m[0] + m[1] * m[1] > scene->stop * scene->stop;
  double slope[3] = {to[0] / -to[2] - m[0] / scene->f, to[1] / -to[2] - m[1] / scene->f, -1};
  double length = sqrt(dot(slope, slope));
  for (int i = 0; i < 3; i++) slope[i] /= length;
  into_world(scene->lens_turn, m, ray->at);
  into_world(scene->lens_turn, slope, ray->to);
  for (int i = 0; i < 3; i++) ray->at[i] += scene->lens_at[i];
  if (scene->inner <= 0) return 1;
  return leave_sphere(ray, scene->shell_at, scene->inner, 1 / scene->n_shell) &&
         leave_sphere(ray, scene->shell_at, scene->outer, scene->n_shell / scene->n_out);
}

/* Where the ray meets the board's plane, in the board's own coordinates. Returns the way to there, < 0 for never. */
static double meet(const Board *board, const Ray *ray, double *x, double *y) {
  double down = dot(board->normal, ray->to);
  if (down == 0) return -1;
  double to_board[3];
  for (int i = 0; i < 3; i++) to_board[i] = board->point[i] - ray->at[i];
  double way = dot(board->normal, to_board) / down;
  double place[3];
  for (int i = 0; i < 3; i++) place[i] = way * ray->to[i] - to_board[i];
  *x = dot(place, board->along_x);
  *y = dot(place, board->along_y);
  return way;
}

static long wrap(long i, long n) { return (i % n + n) % n; }

/* The board's radiance: the texture interpolated bilinearly, which as an object on the board is exact. */
static double shine(const Board *board, double x, double y) {
  if (!board->texture) return board->high;
  double tx = x / board->texel + board->shift_x, ty = y / board->texel + board->shift_y;
  double fx = floor(tx), fy = floor(ty);
  long x0 = wrap((long)fx, board->width), x1 = wrap((long)fx + 1, board->width);
  const float *row0 = board->texture + wrap((long)fy, board->height) * board->width;
  const float *row1 = board->texture + wrap((long)fy + 1, board->height) * board->width;
  tx -= fx;
  ty -= fy;
  double value = (1 - ty) * ((1 - tx) * row0[x0] + tx * row0[x1]) + ty * ((1 - tx) * row1[x0] + tx * row1[x1]);
  return board->low + (board->high - board->low) * value;
}

static double look(const Scene *scene, const double *p, const double *u, const double *c) {
  Ray ray;
  int blocked;
  if (!trace(scene, p, u, c, &ray, &blocked) || blocked) return 0;
  double nearest = INFINITY, value = scene->background, x, y;
  for (int i = 0; i < scene->boards; i++) {
    const Board *board = &scene->board[i];
    double way = meet(board, &ray, &x, &y);
    if (way > 0 && way < nearest && x >= board->x_min && x < board->x_max && y >= board->y_min && y < board->y_max) {
      nearest = way;
      value = shine(board, x, y);
    }
  }
  return value;
}

/* Renders width x height pixels into `out`, white being 1 where nothing is blocked. `samples` rows of four numbers
 * in -1..1: place in the pixel (halves of it), place on the microlens (its radius being 1). */
void render(const Scene *scene, int width, int height, int count, const double *samples, float *out) {
  /* The main lens's centre in the array's frame, through which chief rays pass. */
  double centre[3], away[3];
  for (int i = 0; i < 3; i++) away[i] = scene->lens_at[i] - scene->array_at[i];
  out_of_world(scene->array_turn, away, centre);
  double inward = scene->b / (scene->b - centre[2]);
  const double *g = scene->first, *h = scene->second;
  double area = g[0] * h[1] - g[1] * h[0];
  for (int row = 0; row < height; row++)
    for (int column = 0; column < width; column++) {
      double sum = 0;
      for (int k = 0; k < count; k++) {
        const double *sample = samples + 4 * k;
        double p[2] = {(column - scene->axis_x + sample[0] / 2) * scene->pixel,
                       (row - scene->axis_y + sample[1] / 2) * scene->pixel};
        /* Where the chief ray of p passes the array, and the lattice there. */
        double q[2] = {p[0] + inward * (centre[0] - p[0]), p[1] + inward * (centre[1] - p[1])};
        double rx = q[0] - scene->origin[0], ry = q[1] - scene->origin[1];
        double i0 = floor((rx * h[1] - ry * h[0]) / area), j0 = floor((ry * g[0] - rx * g[1]) / area);
        double best = INFINITY, own[2] = {0, 0};
        int reach = scene->baffled ? 1 : 2;
        for (double i = i0 - reach + (scene->baffled ? 1 : 0); i <= i0 + reach; i++)
          for (double j = j0 - reach + (scene->baffled ? 1 : 0); j <= j0 + reach; j++) {
            double c[2] = {scene->origin[0] + i * g[0] + j * h[0], scene->origin[1] + i * g[1] + j * h[1]};
            if (scene->baffled) {
              double distance = (c[0] - q[0]) * (c[0] - q[0]) + (c[1] - q[1]) * (c[1] - q[1]);
              if (distance < best) best = distance, own[0] = c[0], own[1] = c[1];
            } else {
              double u[2] = {c[0] + scene->microlens * sample[2], c[1] + scene->microlens * sample[3]};
              sum += look(scene, p, u, c);
            }
          }
        if (scene->baffled) {
          double u[2] = {own[0] + scene->microlens * sample[2], own[1] + scene->microlens * sample[3]};
          sum += look(scene, p, u, own);
        }
      }
      out[(size_t)row * width + column] = (float)(sum / count);
    }
}

/* Where chief rays, from pixels p through the centres c of microlenses (array frame), meet a board's plane, edges or
 * not. NaN where a ray gets lost. The aperture stops none of them. */
void chief(const Scene *scene, int board, long count, const double *c, const double *p, double *out) {
  for (long k = 0; k < count; k++) {
    Ray ray;
    int blocked;
    out[2 * k] = out[2 * k + 1] = NAN;
    if (trace(scene, p + 2 * k, c + 2 * k, c + 2 * k, &ray, &blocked))
      meet(&scene->board[board], &ray, &out[2 * k], &out[2 * k + 1]);
  }
}

/* Where pixels p see a board's plane through the microlenses at c, on the mean over the rays that the aperture lets
 * through, `samples` as in `render`: towards the edge of a micro-image the aperture cuts off one side of the microlens.
 * NaN where no ray gets through. */
void seen(const Scene *scene, int board, long count, const double *c, const double *p, int rays, const double *samples,
          double *out) {
  for (long k = 0; k < count; k++) {
    double sum_x = 0, sum_y = 0;
    long open = 0;
    for (int i = 0; i < rays; i++) {
      const double *sample = samples + 4 * i;
      double from[2] = {p[2 * k] + sample[0] / 2 * scene->pixel, p[2 * k + 1] + sample[1] / 2 * scene->pixel};
      double u[2] = {c[2 * k] + scene->microlens * sample[2], c[2 * k + 1] + scene->microlens * sample[3]};
      double x, y;
      Ray ray;
      int blocked;
      if (!trace(scene, from, u, c + 2 * k, &ray, &blocked) || blocked) continue;
      meet(&scene->board[board], &ray, &x, &y);
      sum_x += x;
      sum_y += y;
      open++;
    }
    out[2 * k] = open ? sum_x / open : NAN;
    out[2 * k + 1] = open ? sum_y / open : NAN;
  }
}

/* The direction beyond all glass of the same chief rays: unit vectors in the world. */
void direction(const Scene *scene, long count, const double *c, const double *p, double *out) {
  for (long k = 0; k < count; k++) {
    Ray ray = {{0, 0, 0}, {NAN, NAN, NAN}};
    int blocked;
    if (!trace(scene, p + 2 * k, c + 2 * k, c + 2 * k, &ray, &blocked)) ray.to[0] = ray.to[1] = ray.to[2] = NAN;
    for (int i = 0; i < 3; i++) out[3 * k + i] = ray.to[i];
  }
}
