# docker build -t vlscan . && docker run --rm -v "$PWD:/work" vlscan run survey.xml -o points.laz
FROM rust:1-slim AS build
WORKDIR /src
COPY . .
RUN cargo build --release --locked --features parquet-zstd

FROM debian:stable-slim
COPY --from=build /src/target/release/vlscan /usr/local/bin/vlscan
WORKDIR /work
ENTRYPOINT ["vlscan"]
