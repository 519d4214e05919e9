# mapfit in a container:
#   docker build -t mapfit . && docker run --rm -v mapfit:/var/lib/mapfit mapfit keys create --scopes read,submit,admin
#   docker run -p 8080:8080 -v mapfit:/var/lib/mapfit --read-only --tmpfs /tmp mapfit serve --listen 0.0.0.0:8080
# Without API keys it listens on loopback only (docker run --network host). With PostgreSQL and S3: deploy/compose.yaml.
FROM rust:1.95-bookworm AS build
WORKDIR /src
COPY Cargo.toml Cargo.lock ./
COPY assets assets
COPY benches benches
COPY console console
COPY examples examples
COPY migrations migrations
COPY src src
RUN cargo build --release --locked --bin mapfit

FROM debian:bookworm-slim
# Whom to believe: S3, a database and webhooks' receivers may speak TLS.
# hadolint ignore=DL3008
RUN apt-get update && apt-get install -y --no-install-recommends ca-certificates && rm -rf /var/lib/apt/lists/*
RUN useradd --system --uid 10001 --home-dir /var/lib/mapfit mapfit \
    && install -d -o mapfit -g mapfit /var/lib/mapfit
COPY --from=build /src/target/release/mapfit /usr/local/bin/mapfit
USER 10001
ENV MAPFIT_DATA=/var/lib/mapfit
VOLUME /var/lib/mapfit
EXPOSE 8080
STOPSIGNAL SIGTERM
HEALTHCHECK --interval=15s --timeout=3s --start-period=5s CMD ["mapfit", "health"]
ENTRYPOINT ["mapfit"]
CMD ["serve"]
