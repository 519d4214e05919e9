// The problem of examples/side_by_side in Ceres, at the best settings known for it: parameter blocks of size one, one
// residual block a cell, analytic Jacobians, nested dissection, one thread. Prints seconds and cost a step as CSV; with "covariance" as
// third word, the time that Ceres's Covariance takes for the diagonal at the end.
//
//   ceres DIR SECONDS [covariance]
#include <ceres/ceres.h>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

struct Return { double t, w, weight; };

static void basis(double t, double* b, double* d) {
  double s = 1 - t;
  b[0] = s * s * s / 6;
  b[1] = (3 * t * t * t - 6 * t * t + 4) / 6;
  b[2] = (-3 * t * t * t + 3 * t * t + 3 * t + 1) / 6;
  b[3] = t * t * t / 6;
  d[0] = -s * s / 2;
  d[1] = (3 * t * t - 4 * t) / 2;
  d[2] = (-3 * t * t + 2 * t + 1) / 2;
  d[3] = t * t / 2;
}

// Ceres minimises half the sum of squares, so residuals carry a factor sqrt(2): costs are then the objective's own.
class Cell : public ceres::CostFunction {
 public:
  Cell(double h, double rho, std::vector<Return> returns) : returns_(std::move(returns)) {
    scale_ = std::sqrt(2 * rho * h * h / 4);
    const double gauss[2] = {0.2113248654051871, 0.7886751345948129};
    for (int q = 0; q < 4; ++q) {
      double b[4], db[4], c[4], dc[4];
      basis(gauss[q % 2], b, db);
      basis(gauss[q / 2], c, dc);
      for (int k = 0; k < 16; ++k) {
        dx_[q][k] = db[k % 4] * c[k / 4] / h;
        dy_[q][k] = b[k % 4] * dc[k / 4] / h;
      }
    }
    for (const Return& r : returns_) {
      double b[4], db[4], c[4], dc[4];
      basis(r.t, b, db);
      basis(r.w, c, dc);
      std::vector<double> row(16);
      for (int k = 0; k < 16; ++k) row[k] = std::sqrt(2 * r.weight) * b[k % 4] * c[k / 4];
      rows_.push_back(row);
    }
    set_num_residuals(4 + static_cast<int>(returns_.size()));
    mutable_parameter_block_sizes()->assign(16, 1);
  }
  bool Evaluate(double const* const* p, double* r, double** j) const override {
    for (int q = 0; q < 4; ++q) {
      double gx = 0, gy = 0;
      for (int k = 0; k < 16; ++k) { gx += dx_[q][k] * p[k][0]; gy += dy_[q][k] * p[k][0]; }
      r[q] = scale_ * (gx * gx + gy * gy - 1);
      if (j)
        for (int k = 0; k < 16; ++k)
          if (j[k]) j[k][q] = scale_ * 2 * (gx * dx_[q][k] + gy * dy_[q][k]);
    }
    for (size_t n = 0; n < rows_.size(); ++n) {
      double u = 0;
      for (int k = 0; k < 16; ++k) u += rows_[n][k] * p[k][0];
      r[4 + n] = u;
      if (j)
        for (int k = 0; k < 16; ++k)
          if (j[k]) j[k][4 + n] = rows_[n][k];
    }
    return true;
  }

 private:
  std::vector<Return> returns_;
  std::vector<std::vector<double>> rows_;
  double scale_, dx_[4][16], dy_[4][16];
};

struct Print : ceres::IterationCallback {
  ceres::CallbackReturnType operator()(const ceres::IterationSummary& s) override {
    printf("%.6f,%.9f,%.3e\n", s.cumulative_time_in_seconds, s.cost, s.gradient_max_norm);
    fflush(stdout);
    return ceres::SOLVER_CONTINUE;
  }
};

// Geometric nested dissection of a grid whose points couple to three neighbours on either side: halves first, separator last.
static void dissect(int i0, int i1, int j0, int j1, int stride, std::vector<int>& order) {
  int w = i1 - i0, h = j1 - j0;
  if (w <= 8 && h <= 8) {
    for (int j = j0; j < j1; ++j)
      for (int i = i0; i < i1; ++i) order.push_back(i + j * stride);
    return;
  }
  if (w >= h) {
    int m = i0 + w / 2 - 1;
    dissect(i0, m, j0, j1, stride, order);
    dissect(m + 3, i1, j0, j1, stride, order);
    for (int j = j0; j < j1; ++j)
      for (int i = m; i < m + 3; ++i) order.push_back(i + j * stride);
  } else {
    int m = j0 + h / 2 - 1;
    dissect(i0, i1, j0, m, stride, order);
    dissect(i0, i1, m + 3, j1, stride, order);
    for (int j = m; j < m + 3; ++j)
      for (int i = i0; i < i1; ++i) order.push_back(i + j * stride);
  }
}

template <typename T>
static std::vector<T> read(const std::string& file, size_t n) {
  std::vector<T> v(n);
  std::ifstream(file, std::ios::binary).read(reinterpret_cast<char*>(v.data()), n * sizeof(T));
  return v;
}

int main(int argc, char** argv) {
  if (argc < 3) return 2;
  std::string dir = std::string(argv[1]) + "/";
  int nx, ny;
  double h, rho;
  size_t n;
  std::ifstream(dir + "meta.txt") >> nx >> ny >> h >> rho >> n;
  auto cells = read<int64_t>(dir + "cells.i64", n);
  auto flat = read<double>(dir + "returns.f64", 3 * n);
  auto x = read<double>(dir + "start.f64", size_t(nx + 3) * (ny + 3));
  std::vector<std::vector<Return>> seen(size_t(nx) * ny);
  for (size_t k = 0; k < n; ++k) seen[cells[k]].push_back({flat[3 * k], flat[3 * k + 1], flat[3 * k + 2]});
  ceres::Problem problem;
  for (int j = 0; j < ny; ++j)
    for (int i = 0; i < nx; ++i) {
      std::vector<double*> blocks;
      for (int b = 0; b < 4; ++b)
        for (int a = 0; a < 4; ++a) blocks.push_back(&x[(i + a) + size_t(j + b) * (nx + 3)]);
      problem.AddResidualBlock(new Cell(h, rho, seen[i + size_t(j) * nx]), nullptr, blocks);
    }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  options.sparse_linear_algebra_library_type = ceres::SUITE_SPARSE;
  // Ceres 2.1 has no switch for nested dissection: every block in a group of its own fixes the order.
  std::vector<int> order;
  dissect(0, nx + 3, 0, ny + 3, nx + 3, order);
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (size_t step = 0; step < order.size(); ++step) ordering->AddElementToGroup(&x[order[step]], int(step));
  options.linear_solver_ordering = ordering;
  options.max_num_iterations = 200;
  options.max_solver_time_in_seconds = atof(argv[2]);
  options.function_tolerance = 0;
  options.gradient_tolerance = 0;
  options.parameter_tolerance = 0;
  options.num_threads = 1;
  options.logging_type = ceres::SILENT;
  Print print;
  options.callbacks.push_back(&print);
  printf("seconds,cost,gradient\n");
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  if (argc > 3) {
    auto begun = std::chrono::steady_clock::now();
    ceres::Covariance::Options how;
    how.algorithm_type = ceres::SPARSE_QR;
    ceres::Covariance covariance(how);
    std::vector<std::pair<const double*, const double*>> pairs;
    for (double& v : x) pairs.push_back({&v, &v});
    bool ok = covariance.Compute(pairs, &problem);
    std::chrono::duration<double> took = std::chrono::steady_clock::now() - begun;
    printf("# covariance %.3f %s\n", took.count(), ok ? "ok" : "failed");
  }
}
