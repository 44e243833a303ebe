# docker build -f packaging/serve.Dockerfile -t vlscan-serve .
FROM rust:1-slim AS build
RUN apt-get update && apt-get install -y --no-install-recommends gcc libc6-dev
WORKDIR /src
COPY . .
RUN cargo build --release --locked -p vlscan -p vlscan-serve --features vlscan/parquet-zstd,vlscan-serve/s3

FROM debian:stable-slim
# Certificates are for buckets.
RUN apt-get update && apt-get install -y --no-install-recommends ca-certificates && rm -rf /var/lib/apt/lists/*
COPY --from=build /src/target/release/vlscan /src/target/release/vlscan-serve /usr/local/bin/
RUN useradd --system --create-home --home-dir /data --shell /usr/sbin/nologin vlscan
USER vlscan
VOLUME /data
EXPOSE 8080
ENTRYPOINT ["vlscan-serve", "--data", "/data"]
